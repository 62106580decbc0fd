#include <pi_node/option_check.h>
#include <pi_slam/imu_sample.h>

#include <fstream>
#include <iomanip>
#include <stdexcept>

#include "camera/calibration_yaml.h"

namespace pi_slam
{

namespace
{

constexpr double LEAST_IMU_SCALE = 0.8;

void checkScale(const pi_node::OptionCheck& check, const char* field, const std::vector<double>& scale)
{
  if (scale.size() != 3)
  {
    throw std::invalid_argument(std::string("imu/") + field + " has " + std::to_string(scale.size()) +
                                " numbers, must have three: x y z");
  }
  for (const double axis : scale)
  {
    check.range(field, axis, LEAST_IMU_SCALE, 1.0 / LEAST_IMU_SCALE);
  }
}

/// Kalibr's M: the sensor says M times what is. What its axes have of each other is not used.
std::vector<double> scaleOf(const YamlMap& sensor)
{
  const std::vector<std::vector<double>> rows = sensor.rows("M");
  if (rows.size() != 3 || rows[0].size() != 3 || rows[1].size() != 3 || rows[2].size() != 3)
  {
    throw CalibrationError(sensor.name() + ": M is no 3x3 matrix");
  }
  return {rows[0][0], rows[1][1], rows[2][2]};
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
  checkScale(check, "gyro_scale", gyro_scale);
  checkScale(check, "accel_scale", accel_scale);
}

ImuModel ImuModel::loadYaml(const std::string& file)
{
  YAML::Node node = loadCalibrationYaml(file);
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
  const YamlMap yaml(file, node);
  ImuModel model;
  model.rate_hz = yaml.number(yaml.has("rate_hz") ? "rate_hz" : "update_rate");
  model.gyro_noise_density = yaml.number("gyroscope_noise_density");
  model.gyro_random_walk = yaml.number("gyroscope_random_walk");
  model.accel_noise_density = yaml.number("accelerometer_noise_density");
  model.accel_random_walk = yaml.number("accelerometer_random_walk");
  if (yaml.has("gyroscopes"))
  {
    model.gyro_scale = scaleOf(yaml.child("gyroscopes"));
  }
  if (yaml.has("accelerometers"))
  {
    model.accel_scale = scaleOf(yaml.child("accelerometers"));
  }
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

void ImuModel::saveYaml(const std::string& file) const
{
  std::ofstream stream(file);
  stream << std::setprecision(12) << "imu0:\n  accelerometer_noise_density: " << accel_noise_density
         << "\n  accelerometer_random_walk: " << accel_random_walk
         << "\n  gyroscope_noise_density: " << gyro_noise_density << "\n  gyroscope_random_walk: " << gyro_random_walk
         << "\n  update_rate: " << rate_hz << "\n  model: scale-misalignment\n";
  const auto writeScale = [&](const char* sensor, const std::vector<double>& scale)
  {
    stream << "  " << sensor << ":\n    M:\n    - [" << scale[0] << ", 0, 0]\n    - [0, " << scale[1]
           << ", 0]\n    - [0, 0, " << scale[2] << "]\n";
  };
  writeScale("accelerometers", accel_scale);
  writeScale("gyroscopes", gyro_scale);
  stream.close();
  if (!stream)
  {
    throw CalibrationError(file + ": cannot be written; its folder is missing, or has no room");
  }
}

}  // namespace pi_slam
