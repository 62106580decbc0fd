#pragma once

#include <pi_detect/DetectObjects.h>
#include <pi_detect/object_tracker.h>
#include <pi_detect/picture_motion.h>
#include <pi_detect/ros/message_picture.h>
#include <pi_node/rate_limit.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "ros/camera_turn.h"
#include "ros/overlay.h"
#include "ros/ssd_diagnostics.h"
#include "ros/ssd_ros_options.h"

namespace pi_detect
{

/// Finds and follows objects, on the thread `ssd_worker`: in the newest picture of a topic, and in those of calls.
///
/// The worker keeps its detector while another one is loaded. All functions but start() and stop() may be called by any
/// thread.
class SsdWorker
{
public:
  /// @param options, warnings, diagnostics, turn  outlive it.
  /// @param publish  gets what was found in each picture of the topic, on the thread of the worker.
  SsdWorker(const SsdRosOptions& options, const std::string& topic, pi_node::WarningBoard* warnings,
            SsdDiagnostics* diagnostics, const CameraTurn& turn, std::function<void(const FoundObjects&)> publish);
  SsdWorker(const SsdWorker&) = delete;
  SsdWorker& operator=(const SsdWorker&) = delete;

  void start();
  /// Returns when a picture in work is done. After start() it must be called before destruction.
  void stop();

  /// A picture of the topic. It waits until the worker is free or a newer one comes.
  void add(const pi_os_transport::zero_copy::ImageHandle& picture);
  /// Whether somebody wants tracks.
  void follow(bool wanted) { following_ = wanted; }
  /// Silence on the topic is counted from now on.
  void awaitPictures();
  /// The topic is not subscribed any more.
  void dropPicture();
  /// @return false if the worker has stopped.
  bool detect(const pi_os_transport::zero_copy::ImageHandle& picture, DetectObjects::Response* response);

  void beginLoading(const std::string& model);
  /// @param notice  why this network stands in for another one; empty: it does not.
  void use(std::shared_ptr<Detector> detector, const std::string& notice);
  /// @return the detector that stays in use; null: none.
  std::shared_ptr<const Detector> failLoading(const std::string& problem);

  void report(SsdFigures* figures);

private:
  /// A call of detect(), on its way through the worker.
  struct Call
  {
    pi_os_transport::zero_copy::ImageHandle picture;
    DetectObjects::Response* response;
    bool done = false;
  };

  void work();
  void workOn(const pi_os_transport::zero_copy::ImageHandle& message, const std::shared_ptr<Detector>& detector);
  void serve(const Call& call, Detector* detector);
  std::vector<ObjectTrack> follow(const MessagePicture& picture, const Detections& detections);
  /// Those that the filter of the options lets through.
  Detections wanted(const Detections& all, const ModelDescription& model) const;

  const SsdRosOptions& options_;
  const std::string topic_;
  pi_node::WarningBoard* const warnings_;
  SsdDiagnostics* const diagnostics_;
  const CameraTurn& turn_;
  const std::function<void(const FoundObjects&)> publish_;

  std::atomic<bool> following_{false};
  std::mutex mutex_;  ///< of all below; held briefly
  std::condition_variable work_changed_;
  std::condition_variable call_done_;
  bool stopping_ = false;
  bool ended_ = false;                               ///< and touches no call any more
  std::shared_ptr<Detector> detector_;               ///< null: none is loaded yet; used by the worker alone
  pi_os_transport::zero_copy::ImageHandle picture_;  ///< the newest, that waits
  std::deque<Call*> calls_;
  pi_node::RateLimit rate_limit_;
  int64_t came_at_ns_ = 0;  ///< the last picture
  SsdFigures figures_;      ///< those that the worker knows

  // Of the thread.
  ObjectTracker tracker_;
  PictureMotionEstimator picture_motion_;
  std::vector<Box> boxes_;   ///< of the last picture that was followed
  ros::Time last_followed_;  ///< its stamp
  std::weak_ptr<Detector> worked_with_;
  UsedBits used_bits_;  ///< of the topic's camera
  pi_node::SimulationAnswers answers_;
  std::thread thread_;
};

/// "street on opencl (NVIDIA ...)"
std::string describe(const Detector& detector);

}  // namespace pi_detect
