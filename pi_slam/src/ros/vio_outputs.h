#pragma once

#include <nav_msgs/Odometry.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <tf2_ros/transform_broadcaster.h>

#include <atomic>
#include <cstdint>
#include <deque>
#include <vector>

#include "ros/vio_session.h"

namespace pi_slam
{

/// Publishes odometry, map_pose, tf, path, points and ~debug/tracks. What costs time is published only while somebody
/// listens.
class VioOutputs
{
public:
  /// All arguments but the handles outlive it. @param drawing_thread  draws the tracks.
  VioOutputs(const VioRosOptions& options, ros::NodeHandle node, ros::NodeHandle private_node, VioSession* session,
             pi_node::CallbackThread* drawing_thread, pi_node::WarningBoard* warnings);

  /// After each IMU sample, on one thread.
  void publishOdometry(const VioPipeline& pipeline, const PropagatedState& propagated);
  uint64_t odometries() const { return odometries_; }  ///< published so far

  /// After each pair, on the worker's thread. Skips a pair while the one before is drawn.
  void showTracks(const PicturePair& pair, const VioPipeline& pipeline);
  /// On the worker's thread: what was seen before does not belong to what follows.
  void forgetTracks() { earlier_.clear(); }

  // Any thread.
  void imuWorkedOff(int64_t stamp_ns) { imu_answers_.workedOff(stamp_ns); }
  void pairWorkedOff(int64_t stamp_ns) { pair_answers_.workedOff(stamp_ns); }
  int64_t pairWaits(double seconds) { return pair_answers_.waits(seconds); }

  // On the output thread.
  void publishPath();
  void publishPoints();

private:
  /// A pair and what was seen in it, to be drawn.
  struct Tracks
  {
    PicturePair pair;
    FrameFeatures features;
    std::vector<FrameFeatures> earlier;
  };

  void publishTransforms(const VioPipeline& pipeline, const nav_msgs::Odometry& odometry);
  void publishTracks(const Tracks& tracks);

  const VioRosOptions& options_;
  VioSession& session_;
  pi_node::CallbackThread& drawing_thread_;
  pi_node::WarningBoard& warnings_;
  std::atomic<uint64_t> odometries_{0};
  std::atomic<bool> drawing_{false};
  int64_t next_tf_ns_ = 0;             ///< of the IMU's thread
  std::deque<FrameFeatures> earlier_;  ///< of the worker's thread
  tf2_ros::TransformBroadcaster tf_broadcaster_;
  ros::Publisher odometry_;
  ros::Publisher map_pose_;
  ros::Publisher path_;
  ros::Publisher points_;
  ros::Publisher tracks_;
  pi_node::SimulationAnswers imu_answers_;
  pi_node::SimulationAnswers pair_answers_;
};

}  // namespace pi_slam
