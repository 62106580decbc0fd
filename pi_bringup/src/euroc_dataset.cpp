#include <pi_bringup/euroc_dataset.h>

#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <opencv2/core.hpp>
#include <sstream>

namespace pi_bringup
{

namespace
{

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& file, size_t line, const std::string& defect)
{
  throw EurocError(file.string() + ":" + std::to_string(line) + ": " + defect);
}

std::string trimmed(const std::string& text)
{
  const size_t first = text.find_first_not_of(" \t\r");
  return first == std::string::npos ? std::string() : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

/// One line of a table, with what it takes to name it in an error.
struct Row
{
  const fs::path& file;
  size_t line;
  std::vector<std::string> cells;

  double number(size_t column) const
  {
    const std::string& cell = cells.at(column);
    char* end = nullptr;
    const double value = std::strtod(cell.c_str(), &end);
    if (cell.empty() || *end != '\0' || !std::isfinite(value))
    {
      fail(file, line, "column " + std::to_string(column + 1) + " is \"" + cell + "\", expected a finite number");
    }
    return value;
  }

  int64_t nanoseconds(size_t column) const
  {
    const std::string& cell = cells.at(column);
    char* end = nullptr;
    errno = 0;
    const long long value = std::strtoll(cell.c_str(), &end, 10);
    if (cell.empty() || *end != '\0' || errno != 0 || value <= 0)
    {
      fail(file, line, "column " + std::to_string(column + 1) + " is \"" + cell + "\", expected a time stamp [ns]");
    }
    return value;
  }

  /// Decimal seconds without the rounding of a double, which keeps only 0.2 us at today's dates.
  int64_t secondsAsNanoseconds(size_t column) const
  {
    const std::string& cell = cells.at(column);
    const size_t point = cell.find('.');
    const std::string whole = cell.substr(0, point);
    std::string fraction = point == std::string::npos ? std::string() : cell.substr(point + 1);
    const auto digits = [](const std::string& text)
    { return text.find_first_not_of("0123456789") == std::string::npos; };
    if (whole.empty() || whole.size() > 10 || !digits(whole) || !digits(fraction))
    {
      fail(file, line, "column " + std::to_string(column + 1) + " is \"" + cell + "\", expected a time stamp [s]");
    }
    fraction.resize(9, '0');
    return std::stoll(whole) * 1000000000LL + std::stoll(fraction);
  }
};

/// Calls `take` for each line that is neither empty nor a comment.
/// @param columns fields that each line must have, at least.
void readTable(const fs::path& file, char separator, size_t columns, const std::function<void(const Row&)>& take)
{
  std::ifstream stream(file);
  if (!stream)
  {
    throw EurocError(file.string() + ": missing or not readable; an EuRoC recording needs it");
  }
  std::string text;
  for (size_t line = 1; std::getline(stream, text); ++line)
  {
    const std::string content = trimmed(text);
    if (content.empty() || content.front() == '#')
    {
      continue;
    }
    Row row{file, line, {}};
    std::istringstream fields(content);
    std::string field;
    while (std::getline(fields, field, separator))
    {
      field = trimmed(field);
      if (separator != ' ' || !field.empty())
      {
        row.cells.push_back(field);
      }
    }
    if (row.cells.size() < columns)
    {
      fail(file, line,
           "has " + std::to_string(row.cells.size()) + " of " + std::to_string(columns) + " columns: \"" +
               content.substr(0, 80) + "\"");
    }
    take(row);
  }
}

template <typename Sample>
void append(const Row& row, Sample sample, std::vector<Sample>* samples)
{
  if (!samples->empty() && sample.stamp_ns <= samples->back().stamp_ns)
  {
    fail(row.file, row.line,
         "stamp " + std::to_string(sample.stamp_ns) + " does not come after the previous one, " +
             std::to_string(samples->back().stamp_ns));
  }
  samples->push_back(std::move(sample));
}

/// sensor.yaml, with errors that name the file and the key.
class SensorYaml
{
public:
  explicit SensorYaml(const fs::path& file) : file_(file)
  {
    std::ifstream stream(file);
    if (!stream)
    {
      throw EurocError(file.string() + ": missing or not readable; it holds the calibration of the sensor");
    }
    // OpenCV insists on the %YAML directive, which the original EuRoC files do not have, and takes a comment behind a
    // text for part of it.
    std::string text = "%YAML:1.0\n---\n";
    std::string line;
    while (std::getline(stream, line))
    {
      const std::string content = trimmed(line);
      if (content.rfind("%", 0) != 0 && content != "---")
      {
        text += line.substr(0, line.find(" #")) + "\n";
      }
    }
    try
    {
      storage_.open(text, cv::FileStorage::READ | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_YAML);
    }
    catch (const cv::Exception& exception)
    {
      throw EurocError(file.string() + ": not readable as YAML: " + exception.err);
    }
    if (!storage_.isOpened())
    {
      throw EurocError(file.string() + ": not readable as YAML");
    }
  }

  std::vector<double> numbers(const cv::FileNode& node, const std::string& key, size_t count) const
  {
    std::vector<double> values;
    if (node.isSeq())
    {
      for (const cv::FileNode& element : node)
      {
        if (element.isReal() || element.isInt())
        {
          values.push_back(element.real());
        }
      }
    }
    if (values.size() != count || node.size() != count)
    {
      throw EurocError(file_.string() + ": " + key + " must be a list of " + std::to_string(count) + " numbers");
    }
    return values;
  }

  std::vector<double> numbers(const std::string& key, size_t count) const { return numbers(storage_[key], key, count); }

  /// @param fallback value where the key is absent; nullopt makes the key mandatory.
  double number(const std::string& key, std::optional<double> fallback = std::nullopt) const
  {
    const cv::FileNode node = storage_[key];
    if (node.isReal() || node.isInt())
    {
      return node.real();
    }
    if (!node.empty() || !fallback)
    {
      throw EurocError(file_.string() + ": " + key + " must be a number");
    }
    return *fallback;
  }

  void expect(const std::string& key, const std::string& value) const
  {
    const cv::FileNode node = storage_[key];
    const std::string found = node.isString() ? node.string() : std::string();
    if (found != value)
    {
      throw EurocError(file_.string() + ": " + key + " is \"" + found + "\", only \"" + value + "\" is supported");
    }
  }

  Eigen::Isometry3d transform(const std::string& key) const
  {
    const std::vector<double> values = numbers(storage_[key]["data"], key + "/data", 16);
    Eigen::Matrix4d matrix;
    for (int i = 0; i < 16; ++i)
    {
      matrix(i / 4, i % 4) = values[static_cast<size_t>(i)];
    }
    // Files carry about ten digits.
    const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
    const bool rigid = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-4 &&
                       rotation.determinant() > 0.0 && (matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() < 1e-9;
    if (!rigid)
    {
      throw EurocError(file_.string() + ": " + key + " is not a rigid transform");
    }
    Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
    transform.linear() = Eigen::Quaterniond(rotation).normalized().toRotationMatrix();
    transform.translation() = matrix.topRightCorner<3, 1>();
    return transform;
  }

private:
  const fs::path file_;
  cv::FileStorage storage_;
};

Camera loadCamera(const fs::path& folder)
{
  Camera camera;
  const SensorYaml yaml(folder / "sensor.yaml");
  yaml.expect("camera_model", "pinhole");
  yaml.expect("distortion_model", "radial-tangential");
  const std::vector<double> resolution = yaml.numbers("resolution", 2);
  camera.calibration.width = static_cast<int>(resolution[0]);
  camera.calibration.height = static_cast<int>(resolution[1]);
  camera.calibration.rate_hz = yaml.number("rate_hz");
  const std::vector<double> intrinsics = yaml.numbers("intrinsics", 4);
  const std::vector<double> distortion = yaml.numbers("distortion_coefficients", 4);
  std::copy(intrinsics.begin(), intrinsics.end(), camera.calibration.intrinsics.begin());
  std::copy(distortion.begin(), distortion.end(), camera.calibration.distortion.begin());
  camera.calibration.T_body_camera = yaml.transform("T_BS");
  if (camera.calibration.width <= 0 || camera.calibration.height <= 0 || !(camera.calibration.rate_hz > 0.0))
  {
    throw EurocError((folder / "sensor.yaml").string() + ": resolution and rate_hz must be above 0");
  }

  readTable(folder / "data.csv", ',', 2,
            [&](const Row& row)
            {
              const fs::path picture = folder / "data" / row.cells[1];
              if (row.cells[1].empty() || !fs::is_regular_file(picture))
              {
                fail(row.file, row.line, "names the picture " + picture.string() + ", which does not exist");
              }
              append(row, ImageEntry{row.nanoseconds(0), picture.string()}, &camera.images);
            });
  if (camera.images.empty())
  {
    throw EurocError((folder / "data.csv").string() + ": names no picture");
  }
  return camera;
}

Imu loadImu(const fs::path& folder)
{
  Imu imu;
  const SensorYaml yaml(folder / "sensor.yaml");
  imu.calibration.rate_hz = yaml.number("rate_hz");
  imu.calibration.gyroscope_noise_density = yaml.number("gyroscope_noise_density", 0.0);
  imu.calibration.accelerometer_noise_density = yaml.number("accelerometer_noise_density", 0.0);
  imu.calibration.T_body_imu = yaml.transform("T_BS");
  readTable(folder / "data.csv", ',', 7,
            [&](const Row& row)
            {
              ImuSample sample;
              sample.stamp_ns = row.nanoseconds(0);
              sample.angular_velocity = {row.number(1), row.number(2), row.number(3)};
              sample.linear_acceleration = {row.number(4), row.number(5), row.number(6)};
              append(row, sample, &imu.samples);
            });
  if (imu.samples.empty())
  {
    throw EurocError((folder / "data.csv").string() + ": has no sample");
  }
  return imu;
}

Eigen::Isometry3d poseOf(const Row& row, const Eigen::Vector3d& position, const Eigen::Quaterniond& orientation)
{
  if (std::abs(orientation.norm() - 1.0) > 1e-2)
  {
    fail(row.file, row.line, "quaternion has norm " + std::to_string(orientation.norm()) + ", expected 1");
  }
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = orientation.normalized().toRotationMatrix();
  pose.translation() = position;
  return pose;
}

std::vector<GroundTruthPose> loadGroundTruth(const fs::path& folder)
{
  std::vector<GroundTruthPose> poses;
  const fs::path csv = folder / "mav0" / "state_groundtruth_estimate0" / "data.csv";
  const fs::path tum = folder / "groundtruth_tum.txt";
  if (fs::exists(csv))
  {
    readTable(csv, ',', 11,
              [&](const Row& row)
              {
                GroundTruthPose pose;
                pose.stamp_ns = row.nanoseconds(0);
                pose.T_world_body =
                    poseOf(row, {row.number(1), row.number(2), row.number(3)},
                           Eigen::Quaterniond(row.number(4), row.number(5), row.number(6), row.number(7)));
                pose.v_world = Eigen::Vector3d(row.number(8), row.number(9), row.number(10));
                append(row, pose, &poses);
              });
  }
  else if (fs::exists(tum))
  {
    readTable(tum, ' ', 8,
              [&](const Row& row)
              {
                GroundTruthPose pose;
                pose.stamp_ns = row.secondsAsNanoseconds(0);
                pose.T_world_body =
                    poseOf(row, {row.number(1), row.number(2), row.number(3)},
                           Eigen::Quaterniond(row.number(7), row.number(4), row.number(5), row.number(6)));
                append(row, pose, &poses);
              });
  }
  return poses;
}

}  // namespace

EurocDataset EurocDataset::load(const std::string& folder)
{
  const fs::path root(folder);
  const fs::path mav = root / "mav0";
  if (!fs::is_directory(mav / "cam0"))
  {
    throw EurocError((mav / "cam0").string() + ": no such folder; \"" + folder +
                     "\" must be an EuRoC recording, the folder that contains mav0");
  }
  EurocDataset dataset;
  dataset.folder = folder;
  dataset.left = loadCamera(mav / "cam0");
  if (fs::is_directory(mav / "cam1"))
  {
    dataset.right = loadCamera(mav / "cam1");
  }
  if (fs::is_directory(mav / "imu0"))
  {
    dataset.imu = loadImu(mav / "imu0");
  }
  dataset.ground_truth = loadGroundTruth(root);
  return dataset;
}

}  // namespace pi_bringup
