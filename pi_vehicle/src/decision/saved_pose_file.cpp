#include "decision/saved_pose_file.h"

#include <pi_node/yaml_section.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iomanip>

namespace pi_vehicle
{
namespace
{

constexpr double MAX_CLOCK_SET_BACK_S = 5.0;  // of a clock that was set
constexpr double FARTHEST_M = 1e6;
constexpr double FASTEST = 100.0;

double wallTime()
{
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace

void writeSavedPose(const std::string& file, const std::string& map_frame, const SavedPose& pose)
{
  const Eigen::Vector3d p = pose.T_map_base.translation();
  const Eigen::Quaterniond q(pose.T_map_base.linear());
  YAML::Emitter frame;
  frame << YAML::DoubleQuoted << map_frame;
  std::ostringstream text;
  text << std::setprecision(9) << "# Where base_link was, written by pi_vehicle's pose_keeper.\n"
       << "map_frame: " << frame.c_str() << "\n"
       << "position: [" << p.x() << ", " << p.y() << ", " << p.z() << "]\n"
       << "orientation: [" << q.x() << ", " << q.y() << ", " << q.z() << ", " << q.w() << "]\n"
       << "speed: " << pose.speed << "\nodometry_count: " << pose.count << "\n"
       << std::setprecision(16) << "time: " << wallTime() << "\n";
  const std::string part = file + ".part";
  std::ofstream stream(part, std::ios::trunc);
  stream << text.str() << std::flush;
  const bool written = static_cast<bool>(stream);
  const int write_error = errno;
  stream.close();
  std::error_code error(written ? 0 : write_error, std::generic_category());
  if (written)
  {
    std::filesystem::rename(part, file, error);
  }
  if (error)
  {
    throw std::runtime_error("file = " + file + " cannot be written: " + error.message() +
                             "; name one in a folder that exists, with space, and may be written to");
  }
}

std::optional<SavedPose> readSavedPose(const std::string& file, const std::string& map_frame, double max_age_s)
{
  if (!std::filesystem::exists(file))
  {
    return std::nullopt;
  }
  pi_node::YamlSection section = pi_node::YamlSection::load(file);
  const auto frame = section.get<std::string>("map_frame", "a name");
  if (frame != map_frame)
  {
    section.refuse("map_frame", "\"" + frame + "\"", "map_frame of this node, \"" + map_frame + "\"");
  }
  const auto numbers = [&section](const char* field, size_t size)
  {
    const auto values = section.get<std::vector<double>>(field, "a list of numbers");
    const bool good = values.size() == size && std::all_of(values.begin(), values.end(),
                                                           [](double value) { return std::abs(value) <= FARTHEST_M; });
    if (!good)
    {
      section.refuse(field, "(not that)", std::to_string(size) + " finite numbers");
    }
    return values;
  };
  const std::vector<double> p = numbers("position", 3);
  const std::vector<double> q = numbers("orientation", 4);
  const Eigen::Quaterniond orientation(q[3], q[0], q[1], q[2]);
  if (std::abs(orientation.norm() - 1.0) > 1e-3)
  {
    section.refuse("orientation", "of length " + std::to_string(orientation.norm()), "of length 1");
  }
  SavedPose pose;
  pose.T_map_base.linear() = orientation.normalized().toRotationMatrix();
  pose.T_map_base.translation() = Eigen::Vector3d(p[0], p[1], p[2]);
  section.readNumber("speed", -FASTEST, FASTEST, &pose.speed);
  section.read("odometry_count", "a count", &pose.count);
  pose.age_s = wallTime() - section.get<double>("time", "a number of seconds");
  section.finish();
  if (!(pose.age_s <= max_age_s))
  {
    throw std::invalid_argument(file + ": the pose is " + std::to_string(std::lround(pose.age_s / 60.0)) +
                                " min old, must be below max_file_age_s = " + std::to_string(std::lround(max_age_s)) +
                                " s; give the pose on initialpose, or raise it");
  }
  if (pose.age_s < -MAX_CLOCK_SET_BACK_S)
  {
    throw std::invalid_argument(file + ": the pose is " + std::to_string(std::lround(-pose.age_s)) +
                                " s in the future, must be of the past; is the clock of this computer set?");
  }
  pose.age_s = std::max(0.0, pose.age_s);
  return pose;
}

}  // namespace pi_vehicle
