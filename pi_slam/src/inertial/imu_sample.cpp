#include <pi_node/option_check.h>
#include <pi_slam/imu_sample.h>

#include <stdexcept>

#include "camera/calibration_yaml.h"

namespace pi_slam
{

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
