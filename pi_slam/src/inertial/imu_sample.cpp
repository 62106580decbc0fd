#include <pi_slam/imu_sample.h>
#include <pi_slam/stereo_calibration.h>
#include <yaml-cpp/yaml.h>

#include <fstream>
#include <stdexcept>

#include <pi_node/option_check.h>

namespace pi_slam
{

namespace
{

YAML::Node loadFile(const std::string& file)
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

double number(const YAML::Node& node, const std::string& file, const std::string& key)
{
  if (!node[key].IsDefined())
  {
    throw CalibrationError(file + ": has no " + key);
  }
  try
  {
    return node[key].as<double>();
  }
  catch (const YAML::Exception&)
  {
    throw CalibrationError(file + ": " + key + " is not a number");
  }
}

}  // namespace

void ImuModel::validate() const
{
  const pi_node::OptionCheck check("imu");
  check.range("rate_hz", rate_hz, 20.0, 4000.0);
  check.positive("gyro_noise_density", gyro_noise_density);
  check.positive("gyro_random_walk", gyro_random_walk);
  check.positive("accel_noise_density", accel_noise_density);
  check.positive("accel_random_walk", accel_random_walk);
  check.positive("gyro_limit", gyro_limit);
  check.positive("accel_limit", accel_limit);
  check.range("gravity", gravity, 9.5, 10.0);
  check.range("time_offset_s", time_offset_s, -0.5, 0.5);
}

ImuModel ImuModel::loadYaml(const std::string& file)
{
  YAML::Node node = loadFile(file);
  // Kalibr's output has the keys below imu0, its input at the top.
  if (node.IsMap() && node["imu0"].IsMap())
  {
    const YAML::Node inner = node["imu0"];
    node.reset(inner);
  }
  if (!node.IsMap())
  {
    throw CalibrationError(file + ": is no map of keys, expected Kalibr's imu.yaml or EuRoC's sensor.yaml");
  }
  ImuModel model;
  model.rate_hz = number(node, file, node["rate_hz"].IsDefined() ? "rate_hz" : "update_rate");
  model.gyro_noise_density = number(node, file, "gyroscope_noise_density");
  model.gyro_random_walk = number(node, file, "gyroscope_random_walk");
  model.accel_noise_density = number(node, file, "accelerometer_noise_density");
  model.accel_random_walk = number(node, file, "accelerometer_random_walk");
  try
  {
    model.validate();
  }
  catch (const std::invalid_argument& exception)
  {
    throw CalibrationError(file + ": " + exception.what());
  }
  return model;
}

}  // namespace pi_slam
