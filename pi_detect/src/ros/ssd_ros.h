#pragma once

#include <image_transport/image_transport.h>
#include <pi_detect/DetectObjects.h>
#include <pi_detect/SetModel.h>
#include <pi_detect/object_tracker.h>
#include <pi_detect/ros/message_picture.h>
#include "ros/picture_subscription.h"
#include "ros/ssd_diagnostics.h"
#include "ros/ssd_ros_options.h"
#include <pi_detect/ssd_detector.h>
#include <pi_node/rate_limit.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_detect
{

/// Object detection on the graph.
///
/// Four threads: `ssd_input` gets pictures, of which the newest waits for the worker; `ssd_worker` runs the network;
/// `ssd_loader` loads networks, and takes set_model; `ssd_service` takes detect, draws the overlay, looks who listens,
/// and publishes diagnostics. The worker goes on with the network that it has while another one is loaded.
///
/// A model that cannot be used is an error in log and diagnostics; the node stays, and set_model tries again.
class SsdRos
{
public:
  /// Advertises, and begins to load the model. @throws std::invalid_argument for wrong parameters.
  SsdRos(ros::NodeHandle node, ros::NodeHandle private_node);
  /// Waits for a model that is being loaded.
  ~SsdRos();
  SsdRos(const SsdRos&) = delete;
  SsdRos& operator=(const SsdRos&) = delete;

private:
  using Clock = std::chrono::steady_clock;

  /// A call of detect, on its way through the worker.
  struct Call
  {
    pi_os_transport::zero_copy::ImageHandle image;
    DetectObjects::Response* response;
    bool done = false;
  };

  /// A picture with what was found, to be drawn.
  struct Overlay
  {
    std::shared_ptr<const MessagePicture> picture;
    Detections detections;
    std::vector<ObjectTrack> tracks;
    std::shared_ptr<const SsdDetector> detector;
  };

  // ssd_input
  void onImage(const pi_os_transport::zero_copy::ImageHandle& message);

  // ssd_worker
  void work();
  void workOn(const pi_os_transport::zero_copy::ImageHandle& message, const std::shared_ptr<SsdDetector>& detector);
  void serve(const Call& call, SsdDetector* detector);
  Detections wanted(const Detections& all, const ModelDescription& model) const;

  // ssd_loader
  /// @param[out] message  what is in use now, or why not.
  bool load(const std::string& path, std::string* message);
  bool setModel(SetModel::Request& request, SetModel::Response& response);

  // ssd_service
  bool detect(DetectObjects::Request& request, DetectObjects::Response& response);
  void updateSubscription();
  void publishOverlay(const Overlay& overlay);
  void publishDiagnostics();

  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread loader_thread_;
  pi_node::CallbackThread service_thread_;
  ros::NodeHandle input_node_;
  ros::NodeHandle loader_node_;
  ros::NodeHandle service_node_;
  ros::NodeHandle private_node_;
  const SsdRosOptions options_;
  const std::string topic_;
  std::shared_ptr<pi_runtime::Runtime> runtime_;  ///< null: not used
  pi_node::WarningBoard warnings_;
  SsdDiagnostics diagnostics_;

  std::mutex mutex_;  ///< of all below; held briefly
  std::condition_variable work_changed_;
  std::condition_variable call_done_;
  bool stopping_ = false;
  bool worker_ended_ = false;                        ///< and touches no call any more
  std::shared_ptr<SsdDetector> detector_;            ///< null: none could be loaded yet; used by the worker alone
  pi_os_transport::zero_copy::ImageHandle picture_;  ///< the newest, that waits
  std::deque<Call*> calls_;
  pi_node::RateLimit rate_limit_{options_.max_rate_hz};
  uint64_t dropped_ = 0;
  uint64_t left_out_ = 0;
  std::string loading_;  ///< as in SsdFigures
  std::string problem_;

  std::atomic<uint64_t> pictures_{0};
  std::atomic<uint64_t> calls_served_{0};
  std::atomic<Clock::rep> came_at_{0};
  std::atomic<bool> drawing_{false};

  // ssd_worker
  ObjectTracker tracker_;
  std::weak_ptr<SsdDetector> worked_with_;
  // ssd_loader
  std::string asked_for_;
  // ssd_service
  PictureSubscription image_;
  bool subscribed_ = false;

  image_transport::ImageTransport input_transport_;
  image_transport::ImageTransport overlay_transport_;
  ros::Publisher detections_;
  ros::Publisher tracks_;
  ros::Publisher labels_;
  image_transport::Publisher overlay_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer timer_;
  std::thread worker_;
};

}  // namespace pi_detect
