#pragma once

#include "joystick/joystick_device.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/node_parameters.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <sensor_msgs/Joy.h>

#include <memory>
#include <optional>
#include <string>

namespace pi_vehicle
{

/// The parameters of the joystick node; config/joystick.yaml shows each with its unit.
struct JoystickRosOptions : pi_node::NodeParameters<JoystickRosOptions>
{
  std::string device = "/dev/input/js0";  ///< empty: another node publishes `joy`
  double rate = 50.0;                     ///< [Hz]
  double joy_timeout_s = 0.5;             ///< of another node's messages; an older one counts as released [s]
  int dead_man_button = 4;
  int emergency_button = 1;
  int speed_axis = 1;
  int steering_axis = 0;
  double max_speed = 1.5;          ///< at the end of the axis [m/s]
  double dead_zone = 0.1;          ///< of an axis around its middle
  double diagnostic_period = 1.0;  ///< [s]
  double warning_period_s = 5.0;   ///< [s]
  pi_node::MotionLimits limits;    ///< of the vehicle: its curvature is at the end of the steering axis

  void setVehicle(const pi_node::VehicleDescription& vehicle) { limits = vehicle.limits; }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Drives by joystick. Reads the device and publishes `joy` (sensor_msgs/Joy), or takes another node's `joy`. While the
/// dead-man button is held it publishes `remote/cmd_vel` (geometry_msgs/Twist), which the arbiter takes before
/// navigation; released, or without a joystick, one twist of 0 and then nothing. The emergency button publishes
/// `emergency_stop` (std_msgs/Bool), which latches in the driver of the base. One thread.
class JoystickRos
{
public:
  /// @throws std::invalid_argument for wrong parameters.
  JoystickRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~JoystickRos();
  JoystickRos(const JoystickRos&) = delete;
  JoystickRos& operator=(const JoystickRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void onJoy(const sensor_msgs::Joy& message);
  void tick();
  std::optional<sensor_msgs::Joy> readDevice();
  std::optional<sensor_msgs::Joy> lastMessage();
  void drive(const sensor_msgs::Joy& joy);
  void release();
  double axis(const sensor_msgs::Joy& joy, int index) const;
  void report(Status& status) const;

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  const JoystickRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;
  std::unique_ptr<JoystickDevice> device_;  ///< none: `joy` comes from elsewhere
  sensor_msgs::JoyConstPtr message_;        ///< from elsewhere
  int64_t message_ns_ = 0;
  std::string problem_;  ///< why there is no joystick; empty: there is one
  bool held_ = false;
  bool emergency_ = false;
  ros::Publisher joy_publisher_;
  ros::Publisher twist_;
  ros::Publisher emergency_stop_;
  ros::Subscriber joy_;
  pi_node::VehicleTimer timer_;
  pi_node::VehicleTimer diagnostic_timer_;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::JoystickRosOptions>;
