#pragma once

#include <image_transport/image_transport.h>
#include <pi_detect/Track2DArray.h>
#include <pi_detect/obstacle_tracker.h>
#include <pi_detect/ros/conversions.h>
#include "ros/obstacle_markers.h"
#include "ros/obstacles_diagnostics.h"
#include "ros/obstacles_ros_options.h"
#include "ros/picture_subscription.h"
#include "ros/stereo_camera.h"
#include "ros/vehicle_motion.h"
#include <pi_detect/stereo_obstacles.h>
#include <pi_node/rate_limit.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <stereo_msgs/DisparityImage.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace pi_detect
{

/// Obstacles from a stereo camera on the graph.
///
/// Three threads beside that of tf: `obs_input` gets pictures and pairs them, the newest pair waits for the worker;
/// `obs_worker` works on pairs and publishes; `obs_output` looks who listens and publishes diagnostics. Inputs are
/// subscribed while somebody listens.
class ObstaclesRos
{
public:
  /// Advertises. @throws std::invalid_argument for wrong parameters.
  ObstaclesRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~ObstaclesRos();
  ObstaclesRos(const ObstaclesRos&) = delete;
  ObstaclesRos& operator=(const ObstaclesRos&) = delete;

private:
  using Clock = std::chrono::steady_clock;
  enum Side
  {
    LEFT,
    RIGHT,
  };

  /// What is known of one input topic.
  struct Input
  {
    std::string topic;
    bool used = false;
    bool required = true;
    std::atomic<uint64_t> messages{0};
    std::atomic<Clock::rep> came_at{0};
    void note();
    void restart();  ///< silence is counted from now on
    double silentSeconds() const;
  };

  /// A pair or a disparity image, with the calibration that is known.
  struct Job
  {
    StereoPair pair;
    stereo_msgs::DisparityImageConstPtr disparity;
    sensor_msgs::CameraInfoConstPtr infos[2];
    std_msgs::Header header() const
    {
      return disparity ? disparity->header : pi_os_transport::zero_copy::standardHeader(pair.left->header);
    }
  };

  // obs_input
  void onImage(Side side, const pi_os_transport::zero_copy::ImageHandle& message);
  void onDisparity(const stereo_msgs::DisparityImageConstPtr& message);
  void onTracks(const Track2DArrayConstPtr& message);
  bool isStamped(const Input& input, const ros::Time& stamp);
  /// Puts it where the worker takes it. mutex_ is held.
  void offer(Job job);

  // obs_worker
  void work();
  void workOn(const Job& job);
  /// Calibration and mounting of the cameras; what is built on them is kept as long as they stay. @return false, with
  /// the problem set, if they are not known.
  bool prepare(const Job& job);
  StereoObstacles::Result findObstacles(const Job& job, PairFigures* figures);
  std::vector<ObjectTrack> tracksAt(const ros::Time& stamp, std::optional<double>* age_s);
  VehicleState motionAt(const ros::Time& stamp);
  void publish(const Job& job, const StereoObstacles::Result& result, const std::vector<Obstacle>& obstacles);
  void setProblem(const std::string& problem, bool failed);

  // obs_output
  void updateSubscription();
  void subscribe();
  void publishDiagnostics();

  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread output_thread_;
  ros::NodeHandle input_node_;
  ros::NodeHandle output_node_;
  ros::NodeHandle private_node_;
  const ObstaclesRosOptions options_;
  pi_node::WarningBoard warnings_;
  ObstaclesDiagnostics diagnostics_;
  VehicleMotion motion_;

  Input picture_inputs_[2];
  Input info_inputs_[2];
  Input disparity_input_;
  Input track_input_;

  std::mutex mutex_;  ///< of all below; held briefly
  std::condition_variable job_changed_;
  bool stopping_ = false;
  std::optional<Job> job_;  ///< the newest, that waits
  StereoPairing pairing_;
  sensor_msgs::CameraInfoConstPtr infos_[2];
  std::deque<Track2DArrayConstPtr> recent_tracks_;  ///< oldest first
  pi_node::RateLimit rate_limit_{options_.max_rate_hz};
  uint64_t dropped_ = 0;
  uint64_t left_out_ = 0;
  std::string problem_;
  bool problem_failed_ = false;
  std::string motion_problem_;
  bool motion_known_ = false;

  // obs_worker
  sensor_msgs::CameraInfoConstPtr worked_infos_[2];
  std::optional<StereoCamera> camera_;
  std::unique_ptr<Rectifier> rectifiers_[2];
  Eigen::Isometry3d T_base_left_ = Eigen::Isometry3d::Identity();  ///< left rectified optical frame
  std::unique_ptr<StereoObstacles> stereo_;
  ObstacleTracker tracker_;
  ObstacleMarkers marker_maker_;
  Labels labels_;  ///< of the classes that tracks had
  bool worked_with_motion_ = false;

  // obs_output
  bool subscribed_ = false;
  PictureSubscription images_[2];
  std::vector<ros::Subscriber> subscribers_;

  image_transport::ImageTransport transport_;
  ros::Publisher obstacles_;
  ros::Publisher markers_;
  ros::Publisher points_;
  ros::Publisher disparity_;
  ros::WallTimer timer_;
  std::thread worker_;
};

}  // namespace pi_detect
