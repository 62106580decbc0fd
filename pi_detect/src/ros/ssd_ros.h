#pragma once

#include <image_transport/image_transport.h>
#include <pi_detect/DetectObjects.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/SetModel.h>
#include <pi_detect/ros/detection_publisher.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/latched_publisher.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "ros/camera_turn.h"
#include "ros/picture_subscription.h"
#include "ros/ssd_diagnostics.h"
#include "ros/ssd_ros_options.h"
#include "ros/ssd_worker.h"

namespace pi_detect
{

/// Object detection on the graph.
///
/// Four threads: `ssd_input` receives pictures; `ssd_worker` runs the network (SsdWorker); `ssd_loader` loads networks
/// and takes set_model; `ssd_service` takes detect, draws the overlay, watches subscribers, and publishes diagnostics.
///
/// If a model cannot be used, log and diagnostics show an error; the node stays, and set_model tries again.
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
  // ssd_worker
  void publish(const FoundObjects& found);

  // ssd_loader
  /// @param[out] message  what is in use now, or why not.
  bool load(const std::string& model, std::string* message);
  bool setModel(SetModel::Request& request, SetModel::Response& response);

  // ssd_service
  bool detect(DetectObjects::Request& request, DetectObjects::Response& response);
  void updateSubscription();
  void publishOverlay(const FoundObjects& found);
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
  CameraTurn turn_;
  SsdWorker worker_;
  std::atomic<bool> drawing_{false};

  std::string asked_for_;      ///< used on ssd_loader
  PictureSubscription image_;  ///< both used on ssd_service
  bool subscribed_ = false;

  image_transport::ImageTransport input_transport_;
  image_transport::ImageTransport overlay_transport_;
  DetectionPublisher detections_;
  ros::Publisher tracks_;
  pi_node::LatchedPublisher<LabelArray> labels_;
  VisionInfoPublisher vision_info_;
  image_transport::Publisher overlay_;
  std::vector<ros::ServiceServer> services_;
  pi_node::VehicleTimer timer_;
};

}  // namespace pi_detect
