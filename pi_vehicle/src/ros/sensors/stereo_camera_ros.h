#pragma once

#include "ros/sensors/stereo_camera_ros_options.h"
#include "ros/sensors/stereo_pictures.h"
#include "sensors/video_source.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/recent_values.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <pi_node/stereo_pairs.h>
#include <ros/ros.h>

#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// A stereo camera of UVC (V4L2), or a recorded video, as `left/` and `right/image_raw` with `camera_info`: one device
/// with both pictures side by side, or two devices. Services `left/` and `right/set_camera_info`.
///
/// A thread per device, `camera`, reads, converts and publishes; `camera_ros` has services and diagnostics.
class StereoCameraRos
{
public:
  /// Advertises and opens the devices. @throws std::invalid_argument for wrong parameters.
  StereoCameraRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~StereoCameraRos();
  StereoCameraRos(const StereoCameraRos&) = delete;
  StereoCameraRos& operator=(const StereoCameraRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  struct Device
  {
    std::string path;
    std::string text;  ///< of VideoSource
    std::string problem = "begins";
    bool is_lost = false;  ///< problem is an error
    double frame_rate = 0.0;
    uint64_t opened = 0;
  };
  struct Figures
  {
    uint64_t pairs = 0;
    uint64_t undecodable = 0;
    uint64_t unusable = 0;  ///< pictures that cannot be halved, pairs of two sizes
    uint64_t unpaired = 0;
    uint64_t by_arrival = 0;  ///< pictures whose stamp is that of their arrival
  };

  struct StampOfPicture
  {
    int64_t operator()(const VideoPicture& picture) const { return picture.stamp_ns; }
  };

  void startReader(size_t device);
  void onOpened(size_t device, const VideoSource& source);
  void onClosed(size_t device, const std::string& problem, bool error);
  void onPicture(size_t device, VideoPicture picture);
  void count(uint64_t Figures::*figure);
  void publish(const VideoPicture& left, const VideoPicture& right);
  void report(Status& status);
  void summarize(const Figures& lately, double rate, Status* status) const;  ///< under mutex_

  pi_node::CallbackThread thread_;
  ros::NodeHandle node_;
  const StereoCameraRosOptions options_;
  pi_node::WarningBoard warnings_;
  diagnostic_updater::Updater updater_;

  std::mutex pictures_mutex_;  ///< of the two below: two devices' pairs leave in order
  StereoPictures pictures_;
  pi_node::StereoPairs<VideoPicture, StampOfPicture> pairs_;

  std::mutex mutex_;  ///< of the five below
  std::vector<Device> devices_;
  int64_t difference_ns_ = 0;  ///< of two pictures without a partner
  Figures figures_;
  pi_node::RecentValues difference_ms_{200};
  pi_node::RecentValues delay_ms_{200};

  Figures before_;  ///< at the report before
  int64_t before_ns_ = 0;
  std::vector<std::unique_ptr<VideoReader>> readers_;
  pi_node::VehicleTimer timer_;
};

}  // namespace pi_vehicle
