#include <pi_slam/trajectory_file.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

namespace pi_slam
{

namespace
{

std::vector<std::string> split(std::string text, bool* has_commas)
{
  *has_commas = text.find(',') != std::string::npos;
  for (char& character : text)
  {
    character = character == ',' || character == '\r' || character == '\t' ? ' ' : character;
  }
  std::istringstream stream(text);
  std::vector<std::string> cells;
  for (std::string cell; stream >> cell;)
  {
    cells.push_back(cell);
  }
  return cells;
}

bool allDigits(const std::string& text)
{
  return text.find_first_not_of("0123456789") == std::string::npos;
}

StampedPose readPose(const std::string& file, size_t line, const std::vector<std::string>& cells, bool euroc)
{
  if (cells.size() < 8)
  {
    throw RecordingError(
        file, line, "has " + std::to_string(cells.size()) + " columns, expected time, 3 of position, 4 of orientation");
  }
  StampedPose pose;
  if (euroc)
  {
    pose.stamp_ns = allDigits(cells[0]) && cells[0].size() <= 19 ? std::strtoll(cells[0].c_str(), nullptr, 10) : 0;
  }
  if (euroc ? pose.stamp_ns <= 0 : !parseSeconds(cells[0], &pose.stamp_ns))
  {
    throw RecordingError(file, line, "\"" + cells[0] + "\" is no time stamp in " + (euroc ? "nanoseconds" : "seconds"));
  }
  std::array<double, 7> values{};
  for (size_t i = 0; i < values.size(); ++i)
  {
    char* end = nullptr;
    values[i] = std::strtod(cells[i + 1].c_str(), &end);
    if (*end != '\0' || !std::isfinite(values[i]))
    {
      throw RecordingError(
          file, line, "column " + std::to_string(i + 2) + " is \"" + cells[i + 1] + "\", expected a finite number");
    }
  }
  const Eigen::Quaterniond q = euroc ? Eigen::Quaterniond(values[3], values[4], values[5], values[6])
                                     : Eigen::Quaterniond(values[6], values[3], values[4], values[5]);
  if (std::abs(q.norm() - 1.0) > 1e-2)
  {
    throw RecordingError(file, line, "quaternion has norm " + std::to_string(q.norm()) + ", expected 1");
  }
  pose.T_world_body.linear() = q.normalized().toRotationMatrix();
  pose.T_world_body.translation() = Eigen::Vector3d(values[0], values[1], values[2]);
  return pose;
}

}  // namespace

bool parseSeconds(const std::string& text, int64_t* stamp_ns)
{
  const size_t point = text.find('.');
  const std::string whole = text.substr(0, point);
  std::string fraction = point == std::string::npos ? std::string() : text.substr(point + 1);
  if (whole.empty() || whole.size() > 10 || !allDigits(whole) || !allDigits(fraction))
  {
    return false;
  }
  fraction.resize(9, '0');
  *stamp_ns = std::stoll(whole) * 1000000000LL + std::stoll(fraction);
  return true;
}

std::string formatSeconds(int64_t stamp_ns)
{
  const std::string fraction = std::to_string(stamp_ns % 1000000000LL);
  return std::to_string(stamp_ns / 1000000000LL) + "." + std::string(9 - fraction.size(), '0') + fraction;
}

std::vector<StampedPose> readTrajectory(const std::string& file)
{
  std::ifstream stream(file);
  if (!stream)
  {
    throw RecordingError(file + ": missing or not readable; a trajectory file has lines of t x y z qx qy qz qw");
  }
  std::vector<StampedPose> poses;
  size_t line = 0;
  for (std::string text; std::getline(stream, text);)
  {
    ++line;
    bool has_commas = false;
    const std::vector<std::string> cells = split(text, &has_commas);
    if (cells.empty() || cells.front().front() == '#')
    {
      continue;
    }
    const StampedPose pose = readPose(file, line, cells, has_commas);
    if (!poses.empty() && pose.stamp_ns <= poses.back().stamp_ns)
    {
      throw RecordingError(file, line, "time stamp is not after the one before");
    }
    poses.push_back(pose);
  }
  if (poses.size() < 2)
  {
    throw RecordingError(file + ": has " + std::to_string(poses.size()) + " poses, a trajectory needs two or more");
  }
  return poses;
}

}  // namespace pi_slam
