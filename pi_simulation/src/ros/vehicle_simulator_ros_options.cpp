#include "ros/vehicle_simulator_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

#include <algorithm>

namespace pi_simulation
{

namespace parameter_tree = pi_node::parameter_tree;

static void read(const XmlRpc::XmlRpcValue& value, Base* base)
{
  pi_node::parameters::readChoice(value, {Base::SERIAL, Base::TWIST}, base);
}

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(VehicleSimulatorRosOptions& options, Visitor&& visit)
{
  visit("scenario", options.scenario);
  visit("scenario_seed", options.scenario_seed);
  visit("base", options.base);
  visit("link", options.link);
  visit("log", options.log);
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
  visit("map_frame", options.map_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("odom_frame", options.odom_frame);
  visit("imu_frame", options.imu_frame);
  visit("left_frame", options.left_frame);
  visit("right_frame", options.right_frame);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static Eigen::Vector3d positionOf(const pi_node::Mount& mount)
{
  return {mount.x, mount.y, mount.z};
}

void VehicleSimulatorRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("scenario_seed", scenario_seed, 0, 2147483647);
  check.range("cameras/frame_rate", cameras.frame_rate, 0.5, 100.0);
  check.range("cameras/threads", cameras.threads, 1, 64);
  check.range("cameras/nice", cameras.nice, 0, 19);
  check.range("cameras/noise", cameras.noise, 0.0, 10.0);
  check.range("cameras/brightness", cameras.brightness, 0.01, 10.0);
  check.range("realtime_factor", realtime_factor, 0.0, 100.0);
  pace.validate();
  check.range("patience_s", patience_s, 0.1, 3600.0);
  check.range("imu_noise", imu_noise, 0.0, 100.0);
  const std::string frames[] = {map_frame, base_link_frame, odom_frame, imu_frame, left_frame, right_frame};
  const char* const names[] = {"map_frame", "base_link_frame", "odom_frame", "imu_frame", "left_frame", "right_frame"};
  for (size_t i = 0; i < std::size(frames); ++i)
  {
    pi_node::parameters::require(!frames[i].empty(), names[i], "\"\"", "a name");
  }
  const pi_node::Mount& left = vehicle.mount(left_frame);
  const pi_node::Mount& right = vehicle.mount(right_frame);
  for (const std::string& frame : {imu_frame, left_frame, right_frame})
  {
    const pi_node::Mount& mount = vehicle.mount(frame);
    pi_node::parameters::require(mount.roll == 0.0 && mount.pitch == 0.0 && mount.yaw == 0.0,
                                 ("vehicle/mounts/" + frame).c_str(), "(turned)",
                                 "without roll, pitch and yaw to be simulated");
  }
  pi_node::parameters::require(left.x == right.x && left.z == right.z && left.y > right.y,
                               ("vehicle/mounts/" + right_frame).c_str(), "(elsewhere)",
                               ("to the right of " + left_frame + " to be simulated").c_str());
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
  options.chassis.base = base;
  options.chassis.link = link;
  options.chassis.seed = static_cast<uint64_t>(scenario_seed);
  options.imu.seed = static_cast<uint64_t>(scenario_seed);
  options.imu.gyro_noise_density *= imu_noise;
  options.imu.gyro_random_walk *= imu_noise;
  options.imu.accel_noise_density *= imu_noise;
  options.imu.accel_random_walk *= imu_noise;
  options.imu.gyro_bias *= imu_noise;
  options.imu.accel_bias *= imu_noise;
  options.chassis.setVehicle(vehicle);
  options.imu_in_base = positionOf(vehicle.mount(imu_frame));
  options.footprint = vehicle.footprint;
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
  const Eigen::Vector3d left = positionOf(vehicle.mount(left_frame));
  const Eigen::Vector3d right = positionOf(vehicle.mount(right_frame));
  const Eigen::Vector3d imu = positionOf(vehicle.mount(imu_frame));
  pi_slam::StereoCalibration pair =
      pi_slam::StereoCalibration::makeForwardPair(vehicle.picture_width, vehicle.picture_height, left.y() - right.y());
  pair.left.T_body_camera.translation() = left - imu;
  pair.right.T_body_camera.translation() = right - imu;
  return pair;
}

}  // namespace pi_simulation

template struct pi_node::NodeParameters<pi_simulation::VehicleSimulatorRosOptions>;
