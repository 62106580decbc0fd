#pragma once

#include <pi_detect/Track2DArray.h>
#include <pi_detect/obstacle_tracker.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/rate_limit.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "ros/obstacles/obstacle_finder.h"

namespace pi_detect
{

/// Pairs pictures, finds and follows obstacles in the newest pair, on the thread `obs_worker`.
/// All functions but start() and stop() may be called by any thread.
class ObstaclesWorker
{
public:
  /// What was found in a pair. Valid during the call.
  struct Found
  {
    const StereoJob& job;
    const StereoObstacles::Result& result;
    const std::vector<Obstacle>& obstacles;
    const Labels& labels;  ///< of the classes that tracks had
    const ObstacleFinder& finder;
    const std::optional<VehicleState>& vehicle;  ///< nullopt: its motion is not known
  };

  /// @param options, warnings, diagnostics  outlive it.
  /// @param publish  called on the thread of the worker.
  ObstaclesWorker(const ros::NodeHandle& node, const ObstaclesRosOptions& options, const StereoTopics& topics,
                  std::shared_ptr<StereoStages> stages, pi_node::WarningBoard* warnings,
                  ObstaclesDiagnostics* diagnostics, std::function<void(const Found&)> publish);
  ObstaclesWorker(const ObstaclesWorker&) = delete;
  ObstaclesWorker& operator=(const ObstaclesWorker&) = delete;

  void start();
  /// Returns when a pair in work is done. After start() it must be called before destruction.
  void stop();

  void add(Side side, const pi_os_transport::zero_copy::ImageHandle& picture);
  void add(const stereo_msgs::DisparityImageConstPtr& disparity);
  void add(const Track2DArrayConstPtr& tracks);
  void add(Side side, const sensor_msgs::CameraInfoConstPtr& info);
  /// The inputs are subscribed, or not any more: then what waits is forgotten.
  void take(bool wanted);

  void report(ObstaclesFigures* figures);

private:
  /// Makes it the job that waits. mutex_ is held.
  void offer(StereoJob job);

  void work();
  void workOn(const StereoJob& job);
  void setProblem(const ObstacleProblem& problem);
  std::vector<ObjectTrack> tracksAt(const ros::Time& stamp, std::optional<double>* age_s);
  std::optional<VehicleState> motionAt(const ros::Time& stamp, int64_t until_ns);

  const ObstaclesRosOptions& options_;
  pi_node::WarningBoard* const warnings_;
  ObstaclesDiagnostics* const diagnostics_;
  const std::function<void(const Found&)> publish_;
  VehicleMotion motion_;

  std::mutex mutex_;  ///< of all below; held briefly
  std::condition_variable job_changed_;
  bool stopping_ = false;
  std::optional<StereoJob> job_;  ///< the newest, that waits
  StereoPairing pairing_;
  sensor_msgs::CameraInfoConstPtr infos_[2];
  std::deque<Track2DArrayConstPtr> recent_tracks_;  ///< oldest first
  pi_node::RateLimit rate_limit_;
  ObstaclesFigures figures_;  ///< those that the worker knows

  // Of the thread.
  ObstacleFinder finder_;
  ObstacleTracker tracker_;
  Labels labels_;
  bool worked_with_motion_ = false;
  pi_node::SimulationAnswers answers_;
  std::thread thread_;
};

}  // namespace pi_detect
