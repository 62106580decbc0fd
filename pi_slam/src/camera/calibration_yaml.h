#pragma once

#include <pi_slam/stereo_calibration.h>
#include <yaml-cpp/yaml.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace pi_slam
{

/// A file of Kalibr or OpenCV. @throws CalibrationError if it is missing or no YAML.
inline YAML::Node loadCalibrationYaml(const std::string& file)
{
  std::ifstream stream(file);
  if (!stream)
  {
    throw CalibrationError(file + ": missing or not readable");
  }
  // OpenCV's "%YAML:1.0" is no directive that other parsers know.
  std::string text;
  for (std::string line; std::getline(stream, line);)
  {
    text += (line.rfind("%YAML", 0) == 0 ? "" : line) + "\n";
  }
  try
  {
    return YAML::Load(text);
  }
  catch (const YAML::Exception& exception)
  {
    throw CalibrationError(file + ": is not YAML: " + exception.what());
  }
}

/// One map of a YAML file, with what it takes to name it in an error.
class YamlMap
{
public:
  YamlMap(std::string name, YAML::Node node) : name_(std::move(name)), node_(std::move(node)) {}

  static YamlMap load(const std::string& file) { return YamlMap(file, loadCalibrationYaml(file)); }

  const std::string& name() const { return name_; }
  bool has(const std::string& key) const { return node_.IsMap() && node_[key].IsDefined(); }

  YamlMap child(const std::string& key) const { return YamlMap(name_ + ": " + key, find(key)); }

  std::string text(const std::string& key) const
  {
    return parse<std::string>(key, "a word", [](const YAML::Node& node) { return node.as<std::string>(); });
  }

  double number(const std::string& key) const
  {
    return parse<double>(key, "a number", [](const YAML::Node& node) { return node.as<double>(); });
  }

  std::vector<double> numbers(const std::string& key) const
  {
    return parse<std::vector<double>>(key, "a list of numbers",
                                      [](const YAML::Node& node) { return node.as<std::vector<double>>(); });
  }

  std::vector<double> numbers(const std::string& key, size_t count) const
  {
    const std::vector<double> values = numbers(key);
    if (values.size() != count)
    {
      throw CalibrationError(name_ + ": " + key + " has " + std::to_string(values.size()) + " values, expected " +
                             std::to_string(count));
    }
    return values;
  }

  /// Kalibr's list of a matrix' rows.
  std::vector<std::vector<double>> rows(const std::string& key) const
  {
    return parse<std::vector<std::vector<double>>>(
        key, "a matrix", [](const YAML::Node& node) { return node.as<std::vector<std::vector<double>>>(); });
  }

  /// A rigid transform, either EuRoC's {rows, cols, data} or Kalibr's list of four rows.
  Eigen::Isometry3d transform(const std::string& key) const
  {
    std::vector<double> values;
    if (find(key).IsMap())
    {
      values = child(key).numbers("data", 16);
    }
    else
    {
      for (const std::vector<double>& row : rows(key))
      {
        values.insert(values.end(), row.begin(), row.end());
      }
    }
    if (values.size() != 16)
    {
      throw CalibrationError(name_ + ": " + key + " is no 4x4 matrix");
    }
    return rigid(key, Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(values.data()));
  }

private:
  YAML::Node find(const std::string& key) const
  {
    if (!has(key))
    {
      throw CalibrationError(name_ + ": has no " + key);
    }
    return node_[key];
  }

  template <typename Value, typename Convert>
  Value parse(const std::string& key, const std::string& kind, const Convert& convert) const
  {
    const YAML::Node node = find(key);
    try
    {
      return convert(node);
    }
    catch (const YAML::Exception&)
    {
      throw CalibrationError(name_ + ": " + key + " is not " + kind);
    }
  }

  Eigen::Isometry3d rigid(const std::string& key, const Eigen::Matrix4d& matrix) const
  {
    const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
    // Files have few digits.
    if (!((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3) ||
        rotation.determinant() < 0.0 || !matrix.allFinite())
    {
      throw CalibrationError(name_ + ": " + key + " is not a rigid transform");
    }
    Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
    transform.linear() = Eigen::Quaterniond(rotation).normalized().toRotationMatrix();
    transform.translation() = matrix.topRightCorner<3, 1>();
    return transform;
  }

  std::string name_;
  YAML::Node node_;
};

}  // namespace pi_slam
