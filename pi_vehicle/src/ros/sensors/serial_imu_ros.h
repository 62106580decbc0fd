#pragma once

#include "sensors/serial_imu.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/node_parameters.h>
#include <pi_node/ros/vehicle_time.h>
#include <ros/ros.h>
#include <sensor_msgs/Imu.h>

#include <memory>
#include <string>

namespace pi_vehicle
{

/// The parameters of the IMU node; config/serial_imu.yaml shows each with its unit.
struct SerialImuRosOptions : pi_node::NodeParameters<SerialImuRosOptions>
{
  SerialImuOptions imu;
  std::string imu_frame = "imu_link";
  double gyro_deviation = 6e-4;    ///< one sigma of a sample, as is accel_deviation [rad/s]
  double accel_deviation = 0.014;  ///< [m/s^2]
  double diagnostic_period = 1.0;  ///< [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// An IMU on a serial line as `imu/data` (sensor_msgs/Imu, no orientation). Two threads: `serial_imu` reads and
/// publishes, `imu_ros` has the diagnostics.
class SerialImuRos
{
public:
  /// Advertises and opens the line. @throws std::invalid_argument for wrong parameters.
  SerialImuRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~SerialImuRos();
  SerialImuRos(const SerialImuRos&) = delete;
  SerialImuRos& operator=(const SerialImuRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void publish(const ImuMeasurement& measurement, int64_t stamp_ns);
  void report(Status& status);

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  const SerialImuRosOptions options_;
  diagnostic_updater::Updater updater_;
  ros::Publisher publisher_;
  sensor_msgs::Imu message_;  ///< of the thread of the IMU
  SerialImuState before_;     ///< at the report before
  int64_t before_ns_ = 0;
  std::unique_ptr<SerialImu> imu_;
  pi_node::VehicleTimer timer_;
};

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::SerialImuRosOptions>;
