#include "ros/vehicle_simulator_ros_options.h"

#include "ros/simulation_conversions.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

#include <algorithm>

namespace pi_simulation
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(VehicleSimulatorRosOptions& options, Visitor&& visit)
{
  visit("scenario", options.scenario);
  visit("scenario_seed", options.scenario_seed);
  visit("link", options.link);
  visit("log", options.log);
  visit("cameras/width", options.cameras.width);
  visit("cameras/height", options.cameras.height);
  visit("cameras/baseline", options.cameras.baseline);
  visit("cameras/frame_rate", options.cameras.frame_rate);
  visit("cameras/threads", options.cameras.threads);
  visit("cameras/nice", options.cameras.nice);
  visit("cameras/color", options.cameras.color);
  visit("cameras/smooth_edges", options.cameras.smooth_edges);
  visit("cameras/noise", options.cameras.noise);
  visit("cameras/brightness", options.cameras.brightness);
  visit("realtime_factor", options.realtime_factor);
  visit("pace/rendering", options.pace.rendering);
  visit("pace/imu", options.pace.imu);
  visit("pace/pictures", options.pace.pictures);
  visit("pace/detection", options.pace.detection);
  visit("pace/sound", options.pace.sound);
  visit("pace/tick", options.pace.tick);
  visit("pace/chassis", options.pace.chassis);
  visit("patience_s", options.patience_s);
  visit("imu_noise", options.imu_noise);
  visit("imu_in_base/x", options.imu_in_base.x);
  visit("imu_in_base/y", options.imu_in_base.y);
  visit("imu_in_base/z", options.imu_in_base.z);
  visit("outline/front", options.outline.front);
  visit("outline/rear", options.outline.rear);
  visit("outline/half_width", options.outline.half_width);
  visit("outline/height", options.outline.height);
  visit("map_frame", options.map_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("imu_frame", options.imu_frame);
  visit("left_frame", options.left_frame);
  visit("right_frame", options.right_frame);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void VehicleSimulatorRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("scenario_seed", scenario_seed, 0, 2147483647);
  check.range("cameras/width", cameras.width, 64, 4096);
  check.range("cameras/height", cameras.height, 64, 4096);
  check.range("cameras/baseline", cameras.baseline, 0.01, 2.0);
  check.range("cameras/frame_rate", cameras.frame_rate, 0.5, 100.0);
  check.range("cameras/threads", cameras.threads, 1, 64);
  check.range("cameras/nice", cameras.nice, 0, 19);
  check.range("cameras/noise", cameras.noise, 0.0, 10.0);
  check.range("cameras/brightness", cameras.brightness, 0.01, 10.0);
  check.range("realtime_factor", realtime_factor, 0.0, 100.0);
  pace.validate();
  check.range("patience_s", patience_s, 0.1, 3600.0);
  check.range("imu_noise", imu_noise, 0.0, 100.0);
  check.range("imu_in_base/x", imu_in_base.x, -5.0, 5.0);
  check.range("imu_in_base/y", imu_in_base.y, -5.0, 5.0);
  check.range("imu_in_base/z", imu_in_base.z, 0.1, 5.0);
  check.range("outline/front", outline.front, 0.05, 10.0);
  check.range("outline/rear", outline.rear, 0.05, 10.0);
  check.range("outline/half_width", outline.half_width, 0.05, 5.0);
  check.range("outline/height", outline.height, 0.1, 5.0);
  const std::string frames[] = {map_frame, base_link_frame, imu_frame, left_frame, right_frame};
  const char* const names[] = {"map_frame", "base_link_frame", "imu_frame", "left_frame", "right_frame"};
  for (size_t i = 0; i < 5; ++i)
  {
    pi_node::parameters::require(!frames[i].empty(), names[i], "\"\"", "a name");
  }
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
  simulationOptions().validate();
}

VehicleSimulatorRosOptions VehicleSimulatorRosOptions::load(const ros::NodeHandle& private_node,
                                                            std::vector<std::string>* unknown)
{
  VehicleSimulatorRosOptions options = NodeParameters::load(private_node, unknown);
  const std::string& path = private_node.getNamespace();
  pi_node::parameters::require(!options.scenario.empty(), ("parameter " + path + "/scenario").c_str(), "\"\"",
                               "a file of config/scenarios or your own");
  return options;
}

SimulatedTimeOptions VehicleSimulatorRosOptions::timeOptions() const
{
  SimulatedTimeOptions options{realtime_factor, pace, patience_s};
  // Only one exposure waits to be rendered.
  options.pace.rendering = std::min(options.pace.rendering, 0.8 / cameras.frame_rate);
  return options;
}

VehicleSimulationOptions VehicleSimulatorRosOptions::simulationOptions() const
{
  VehicleSimulationOptions options;
  options.chassis.link = link;
  options.chassis.seed = static_cast<uint64_t>(scenario_seed);
  options.imu.seed = static_cast<uint64_t>(scenario_seed);
  options.imu.gyro_noise_density *= imu_noise;
  options.imu.gyro_random_walk *= imu_noise;
  options.imu.accel_noise_density *= imu_noise;
  options.imu.accel_random_walk *= imu_noise;
  options.imu.gyro_bias *= imu_noise;
  options.imu.accel_bias *= imu_noise;
  options.imu_in_base = {imu_in_base.x, imu_in_base.y, imu_in_base.z};
  options.front = outline.front;
  options.rear = outline.rear;
  options.half_width = outline.half_width;
  options.height = outline.height;
  options.frame_rate_hz = cameras.frame_rate;
  return options;
}

StereoRendererOptions VehicleSimulatorRosOptions::rendererOptions() const
{
  StereoRendererOptions options;
  options.threads = cameras.threads;
  options.quality = RenderQuality::LIVE;
  options.supersampling = cameras.smooth_edges ? Supersampling::EDGES : Supersampling::NONE;
  options.brightness = cameras.brightness;
  options.shot_noise *= cameras.noise * cameras.noise;
  options.read_noise *= cameras.noise;
  options.color = cameras.color;
  options.seed = static_cast<uint64_t>(scenario_seed);
  return options;
}

pi_slam::StereoCalibration VehicleSimulatorRosOptions::calibration() const
{
  return pi_slam::StereoCalibration::makeForwardPair(cameras.width, cameras.height, cameras.baseline);
}

tf2_msgs::TFMessage VehicleSimulatorRosOptions::staticTransforms() const
{
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  T_base_body.translation() << imu_in_base.x, imu_in_base.y, imu_in_base.z;
  const pi_slam::StereoCalibration cameras = calibration();
  tf2_msgs::TFMessage message;
  message.transforms = {toTransform(T_base_body, base_link_frame, imu_frame),
                        toTransform(T_base_body * cameras.left.T_body_camera, base_link_frame, left_frame),
                        toTransform(T_base_body * cameras.right.T_body_camera, base_link_frame, right_frame)};
  return message;
}

}  // namespace pi_simulation

template struct pi_node::NodeParameters<pi_simulation::VehicleSimulatorRosOptions>;
