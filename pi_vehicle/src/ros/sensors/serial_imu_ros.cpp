#include "ros/sensors/serial_imu_ros.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/ros/parameter_tree.h>
#include <pi_node/vehicle_clock.h>

#include <cmath>
#include <utility>

namespace pi_vehicle
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(SerialImuRosOptions& options, Visitor&& visit)
{
  visit("port", options.imu.port);
  visit("baud_rate", options.imu.baud_rate);
  visit("rate", options.imu.rate);
  visit("configure", options.imu.configure);
  visit("reconnect_pause_s", options.imu.reconnect_pause_s);
  visit("imu_frame", options.imu_frame);
  visit("gyro_deviation", options.gyro_deviation);
  visit("accel_deviation", options.accel_deviation);
  visit("diagnostic_period", options.diagnostic_period);
}

void SerialImuRosOptions::validate() const
{
  imu.validate();
  const pi_node::OptionCheck check("");
  check.positive("gyro_deviation", gyro_deviation);
  check.positive("accel_deviation", accel_deviation);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
}

namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr uint32_t IMU_QUEUE = 100;
constexpr double RATE_TOLERANCE = 0.05;  ///< of the nominal rate: a second's count is off by a bundle of a USB adapter

}  // namespace

SerialImuRos::SerialImuRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("imu_ros")
  , node_(thread_.handle(node))
  , options_(pi_node::loadNodeOptions<SerialImuRosOptions>(private_node, "serial_imu"))
  , updater_(node_, private_node, private_node.getNamespace())
  , publisher_(node_.advertise<sensor_msgs::Imu>("imu/data", IMU_QUEUE))
{
  message_.header.frame_id = options_.imu_frame;
  message_.orientation_covariance[0] = -1.0;  // no orientation
  for (size_t axis = 0; axis < 3; ++axis)
  {
    message_.angular_velocity_covariance[4 * axis] = options_.gyro_deviation * options_.gyro_deviation;
    message_.linear_acceleration_covariance[4 * axis] = options_.accel_deviation * options_.accel_deviation;
  }
  updater_.setHardwareID(options_.imu.port);
  updater_.add("imu", [this](Status& status) { report(status); });
  before_ns_ = pi_node::vehicleNs();
  SerialImuEvents events;
  events.measurement = [this](const ImuMeasurement& measurement, int64_t stamp_ns) { publish(measurement, stamp_ns); };
  events.well = [](const std::string& path) { ROS_INFO_STREAM_NAMED("serial_imu", "IMU on " << path << " measures"); };
  events.problem = [](const std::string& problem)
  { ROS_ERROR_STREAM_NAMED("serial_imu", problem << "; tried again until it measures"); };
  imu_ = std::make_unique<SerialImu>(options_.imu, std::move(events));
  timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
}

SerialImuRos::~SerialImuRos()
{
  thread_.stop();
  imu_.reset();
}

void SerialImuRos::publish(const ImuMeasurement& measurement, int64_t stamp_ns)
{
  message_.header.stamp = pi_node::rosTime(stamp_ns);
  message_.angular_velocity.x = measurement.angular_velocity[0];
  message_.angular_velocity.y = measurement.angular_velocity[1];
  message_.angular_velocity.z = measurement.angular_velocity[2];
  message_.linear_acceleration.x = measurement.acceleration[0];
  message_.linear_acceleration.y = measurement.acceleration[1];
  message_.linear_acceleration.z = measurement.acceleration[2];
  publisher_.publish(message_);
}

void SerialImuRos::report(Status& status)
{
  const SerialImuState now = imu_->state();
  const int64_t now_ns = pi_node::vehicleNs();
  const double rate =
      static_cast<double>(now.measurements - before_.measurements) / pi_node::secondsBetween(before_ns_, now_ns);
  const uint64_t broken =
      now.wrong_checksums + now.torn + now.not_finite - before_.wrong_checksums - before_.torn - before_.not_finite;
  const uint64_t missed = now.missed - before_.missed;
  if (!now.problem.empty())
  {
    status.summary(DiagnosticStatus::ERROR, now.problem);
  }
  else if (before_.measurements == 0 || now.opened != before_.opened)
  {
    status.summary(DiagnosticStatus::WARN, "begins");
  }
  else if (broken + missed > 0)
  {
    status.summary(DiagnosticStatus::WARN, format("%.0f broken and %.0f missing measurements since the last report; "
                                                  "check cable, ground and baud_rate",
                                                  broken, missed));
  }
  else if (std::abs(rate - options_.imu.rate) > RATE_TOLERANCE * options_.imu.rate)
  {
    status.summary(DiagnosticStatus::ERROR, format("%.1f Hz, but rate = %g: the stamps are wrong; set rate to that of "
                                                   "the device, or configure: true",
                                                   rate, options_.imu.rate));
  }
  else if (options_.imu.configure && !now.configured)
  {
    status.summary(DiagnosticStatus::WARN, "measures, but has not confirmed its configuration");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, format("%.1f Hz", rate));
  }
  status.add("port", now.path);
  status.add("rate [Hz]", format("%.1f", rate));
  status.add("measurements", now.measurements);
  status.add("missing measurements", now.missed);
  status.add("lines with a wrong checksum", now.wrong_checksums);
  status.add("torn lines", now.torn);
  status.add("measurements that are not finite", now.not_finite);
  status.add("other lines", now.other);
  status.add("garbage [bytes]", now.garbage_bytes);
  status.add("times opened", now.opened);
  before_ = now;
  before_ns_ = now_ns;
}

}  // namespace pi_vehicle

template struct pi_node::NodeParameters<pi_vehicle::SerialImuRosOptions>;
