#pragma once

#include <pi_detect/obstacle_tracker.h>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <atomic>
#include <boost/signals2/connection.hpp>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

namespace pi_detect
{

/// Poses of the vehicle and its cameras, from tf.
class VehicleMotion
{
public:
  VehicleMotion(const ros::NodeHandle& node, const std::string& odom_frame, const std::string& base_link_frame);
  ~VehicleMotion();
  VehicleMotion(const VehicleMotion&) = delete;
  VehicleMotion& operator=(const VehicleMotion&) = delete;

  /// The state at a stamp, extrapolated if tf does not reach the stamp in time. Waits only if tf is close.
  /// @param until_ns      longest that it waits, of vehicleNs().
  /// @param[out] problem  why there is no state, or why it is extrapolated; empty: none.
  std::optional<VehicleState> at(const ros::Time& stamp, int64_t until_ns, std::string* problem);

  /// Newest pose of a frame in base_link; nullopt if tf has none.
  std::optional<Eigen::Isometry3d> mounting(const std::string& frame) const
  {
    return lookUp(base_link_frame_, frame, ros::Time(0));
  }

  /// From now on at() does not wait. Any thread.
  void stop();

private:
  std::optional<Eigen::Isometry3d> poseAt(const ros::Time& stamp) const
  {
    return lookUp(odom_frame_, base_link_frame_, stamp);
  }
  std::optional<Eigen::Isometry3d> lookUp(const std::string& parent, const std::string& child,
                                          const ros::Time& stamp) const;
  /// @return false if tf does not get there.
  bool waitFor(const ros::Time& stamp, int64_t until_ns);

  const std::string odom_frame_;
  const std::string base_link_frame_;
  tf2_ros::Buffer buffer_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;
  boost::signals2::connection connection_;
  tf2_ros::TransformListener listener_;
};

}  // namespace pi_detect
