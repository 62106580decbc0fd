#pragma once

#include "ros/simulated_cameras.h"
#include "ros/vehicle_simulator_ros_options.h"
#include "vehicle/vehicle_simulation.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/Twist.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_simulation/SimulatorCommand.h>
#include <ros/ros.h>
#include <std_msgs/String.h>

#include <cstdint>
#include <fstream>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

namespace pi_simulation
{

/// Stands in for sensors, chassis and surroundings. Publishes `imu/data` (sensor_msgs/Imu, 200 Hz), `left/` and
/// `right/image_raw` and `camera_info`, `ground_truth/odometry` (nav_msgs/Odometry, 50 Hz), `ground_truth/obstacles`
/// (pi_detect/ObstacleArray, 20 Hz), `scenario` (std_msgs/String, latched: JSON), static tf and diagnostics. Service
/// `~command` (SimulatorCommand), and the same lines on the topic `~command` (std_msgs/String). The chassis is on the
/// pseudo-terminal that the parameter `link` names, or, as a stock base, takes `cmd_vel` (geometry_msgs/Twist) and
/// tells `odom` (nav_msgs/Odometry, 50 Hz).
///
/// It is the clock, see SimulatedTime. Thread `simulation` steps the world every 2.5 ms of its time and publishes all
/// but pictures; `simulator_ros` has callbacks and diagnostics.
class VehicleSimulatorRos
{
public:
  /// Starts the simulation. @throws std::invalid_argument for wrong parameters or a wrong scenario, std::runtime_error
  /// without a pseudo-terminal or log file.
  VehicleSimulatorRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~VehicleSimulatorRos();
  VehicleSimulatorRos(const VehicleSimulatorRos&) = delete;
  VehicleSimulatorRos& operator=(const VehicleSimulatorRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void openLog();
  void advertise();
  void publishStatic();
  SimulationOutputs outputs();

  // simulation
  void simulate();
  void publishObstacles(int64_t stamp_ns, const std::vector<TrueObstacle>& obstacles);

  // simulator_ros
  bool onCommand(SimulatorCommand::Request& request, SimulatorCommand::Response& response);
  void onTwist(const geometry_msgs::Twist& message);
  void onCommandTopic(const std_msgs::String& message);
  std::string execute(const std::string& line);
  void reportWorld(Status& status);

  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  ros::NodeHandle service_private_node_;
  const VehicleSimulatorRosOptions options_;
  const pi_slam::StereoCalibration calibration_;
  const Scenario scenario_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  SimulatedTime time_;
  SimulatedCameras cameras_;  ///< its threads tell time_
  ros::Publisher imu_;
  ros::Publisher odometry_;
  ros::Publisher obstacles_;
  ros::Publisher base_odometry_;
  pi_node::LatchedPublisher<std_msgs::String> scenario_publisher_;
  ros::Publisher collision_;
  ros::ServiceServer command_;
  ros::Subscriber command_topic_;
  ros::Subscriber twist_;
  pi_node::VehicleTimer timer_;
  std::ofstream log_;
  bool log_failed_ = false;  ///< simulation

  std::mutex simulation_mutex_;
  std::unique_ptr<VehicleSimulation> simulation_;       ///< under simulation_mutex_
  Eigen::Vector2d velocity_ = Eigen::Vector2d::Zero();  ///< simulation: of the vehicle, for the obstacles

  std::thread simulation_thread_;
};

}  // namespace pi_simulation
