#pragma once

#include <pi_bringup/frame_prefetcher.h>
#include <pi_bringup/pacer.h>
#include <pi_bringup/ros/playback_status.h>
#include <pi_bringup/ros/player.h>
#include <pi_bringup/ros/subscriber_gate.h>
#include <pi_bringup/video_reader.h>
#include <pi_os_transport/zero_copy/publisher.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <string>
#include <vector>

namespace pi_bringup
{

/// Parameters of the node, as described in README.md and config/default.yaml.
struct VideoPlayerOptions
{
  std::string file = "/usr/share/doc/opencv-doc/examples/data/vtest.avi";  ///< Debian package opencv-doc
  double rate = 1.0;                                                       ///< seconds of film per second
  bool loop = false;
  double duration_s = 0.0;         ///< of film to play [s]; 0: all
  double frame_rate_hz = 0.0;      ///< 0: as the file says
  double horizontal_fov_deg = 60;  ///< of the nominal camera: nobody has calibrated the real one
  std::string left_frame = "left_optical";
  bool stamp_at_handover = false;  ///< stamps are the time of the hand-over, not the time due: to measure transports
  int queue_size = 20;
  int prefetch_depth = 8;  ///< frames decoded ahead
  bool exit_when_done = true;
  std::vector<std::string> wait_for_subscribers;  ///< see SubscriberGate::require()

  /// @throws std::invalid_argument naming parameter, value and bound.
  void validate() const;
  static VideoPlayerOptions load(const ros::NodeHandle& node);
};

/// Plays a video as left/image_raw (bgr8) with a nominal left/camera_info, and ~status. Stamps are the times at which
/// the frames are due.
class VideoPlayerRos : public Player
{
public:
  /// @throws std::invalid_argument, std::runtime_error for a video that cannot be read.
  VideoPlayerRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~VideoPlayerRos() override;

  void play() override;
  void stop() override;
  bool exitWhenDone() const override { return options_.exit_when_done; }

private:
  ros::NodeHandle node_;
  const VideoPlayerOptions options_;
  VideoReader reader_;
  double frame_rate_hz_ = 0.0;
  Pacer pacer_;
  SubscriberGate gate_;
  PlaybackStatus status_;
  pi_os_transport::zero_copy::Publisher<sensor_msgs::Image> image_;
  ros::Publisher info_;
  sensor_msgs::CameraInfo info_message_;
};

}  // namespace pi_bringup
