#pragma once

#include <nav_msgs/Path.h>
#include <pi_bringup/frame_prefetcher.h>
#include <pi_bringup/pacer.h>
#include <pi_bringup/ros/euroc_messages.h>
#include <pi_bringup/ros/playback_status.h>
#include <pi_bringup/ros/player.h>
#include <pi_bringup/ros/subscriber_gate.h>
#include <pi_bringup/timeline.h>
#include <pi_os_transport/zero_copy/publisher.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <atomic>
#include <memory>
#include <string>
#include <vector>

namespace pi_bringup
{

/// Parameters of the node, as described in README.md and config/default.yaml.
struct EurocPlayerOptions
{
  std::string folder;  ///< recording, the folder that contains mav0; mandatory
  double rate = 1.0;   ///< recorded seconds per second
  bool loop = false;   ///< start again at the end
  TimelineOptions timeline;
  EurocFrames frames;
  bool publish_tf = false;   ///< ground truth as map -> base_link: off when a localisation publishes it
  bool keep_stamps = false;  ///< recorded stamps instead of recorded ones moved to now
  /// Stamps are the time of hand-over to the transport, one for all that was recorded at the same time: to measure
  /// transports, as the player's own delay is then left out. Intervals are no longer those of the recording.
  bool stamp_at_handover = false;
  bool publish_clock = false;  ///< /clock at recorded time; needs keep_stamps
  double clock_rate_hz = 100.0;
  double path_spacing_m = 0.05;  ///< distance between poses of ground_truth/path
  int queue_size = 20;           ///< of the pictures; topics of 200 Hz get ten times as many
  int prefetch_depth = 8;        ///< pictures per camera decoded ahead
  bool exit_when_done = true;
  std::vector<std::string> wait_for_subscribers;  ///< see SubscriberGate::require()

  /// @throws std::invalid_argument naming parameter, value and bound.
  void validate() const;
  /// Defaults overlaid by the parameters below `node`. @throws std::invalid_argument also for a parameter of the wrong
  /// type.
  static EurocPlayerOptions load(const ros::NodeHandle& node);
};

/// Plays an EuRoC recording: left/image_raw, left/camera_info, right/image_raw, right/camera_info, imu/data,
/// ground_truth/odometry, ground_truth/path, tf_static, tf and clock on demand, and ~status.
class EurocPlayerRos : public Player
{
public:
  /// Reads parameters and recording, advertises. @throws EurocError, std::invalid_argument.
  EurocPlayerRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~EurocPlayerRos() override;

  void play() override;
  void stop() override;
  bool exitWhenDone() const override { return options_.exit_when_done; }

private:
  /// @return false if stopped
  bool playLap(int64_t lap_shift_ns);
  void publishItem(const TimelineItem& item, int64_t lap_shift_ns);
  bool publishClockUntil(int64_t recorded_ns);
  ros::Time publishedStamp(int64_t recorded_ns, int64_t lap_shift_ns);
  std::unique_ptr<FramePrefetcher> prefetch(Stream stream);

  ros::NodeHandle node_;
  const EurocPlayerOptions options_;
  const EurocDataset dataset_;
  const EurocMessages messages_;
  const Timeline timeline_;
  Pacer pacer_;
  SubscriberGate gate_;
  PlaybackStatus status_;
  std::atomic<bool> stopped_{false};

  pi_os_transport::zero_copy::Publisher<sensor_msgs::Image> left_image_;
  ros::Publisher left_info_;
  pi_os_transport::zero_copy::Publisher<sensor_msgs::Image> right_image_;
  ros::Publisher right_info_;
  ros::Publisher imu_;
  ros::Publisher odometry_;
  ros::Publisher path_;
  ros::Publisher tf_static_;
  ros::Publisher tf_;
  ros::Publisher clock_;

  std::unique_ptr<FramePrefetcher> left_frames_;
  std::unique_ptr<FramePrefetcher> right_frames_;
  nav_msgs::Path path_message_;
  int64_t path_published_ns_ = 0;
  int64_t next_clock_ns_ = 0;
  int64_t stamp_offset_ns_ = 0;   ///< recorded stamp, plus lap, to published stamp
  int64_t handover_due_ns_ = -1;  ///< recorded time, plus lap, that stamp_offset_ns_ is for with stamp_at_handover
};

}  // namespace pi_bringup
