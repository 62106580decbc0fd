#pragma once

#include <ros/node_handle.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>
#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>

namespace pi_offload
{

/// Brings other frames into the map by tf, which is listened to from the first time on that it is needed. Thread safe.
class MapFrame
{
public:
  MapFrame(const ros::NodeHandle& node, const std::string& map_frame);
  MapFrame(const MapFrame&) = delete;
  MapFrame& operator=(const MapFrame&) = delete;

  /// The newest transform. Empty frames count as the map.
  /// @param[out] problem  why there is none, once per frame until there is one again; empty: there is one, or it was
  ///   said. Nothing is said in the first second in which tf is listened to.
  std::optional<Eigen::Isometry3d> from(const std::string& frame, std::string* problem);

  const std::string& name() const { return map_frame_; }

private:
  using Clock = std::chrono::steady_clock;

  ros::NodeHandle node_;
  const std::string map_frame_;
  std::mutex mutex_;
  Clock::time_point listening_since_;
  std::set<std::string> said_;
  tf2_ros::Buffer buffer_;
  std::unique_ptr<tf2_ros::TransformListener> listener_;
};

}  // namespace pi_offload
