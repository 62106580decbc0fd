#pragma once

#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <nav_msgs/Path.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <pi_slam/LoadMap.h>
#include <pi_slam/SaveMap.h>
#include "map/mapper.h"
#include "odometry/pose_history.h"
#include "ros/calibration_loader.h"
#include "ros/pair_matcher.h"
#include "ros/vio_diagnostics.h"
#include "ros/vio_ros_options.h"
#include "odometry/vio.h"
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

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
#include <utility>
#include <vector>

namespace pi_slam
{

/// Visual-inertial odometry and mapping on the graph.
///
/// Five threads: `vio_imu` gets IMU samples and publishes a pose for each, `vio_input` gets pictures and pairs them,
/// `vio_worker` works on pairs, `vio_output` looks after the calibration and publishes what may be slow, `vio_service`
/// serves calls. The IMU's thread takes no lock that is held during work on pictures, nor while a map is written.
///
/// Odometry begins when the calibration is complete, and begins anew when it changes, when time goes back, and on
/// ~reset. A pose on `initialpose` says where base_link is in map: T_map_odom becomes so, odometry stays. What is wrong
/// with an input is logged, shown in the diagnostics, and the input is not used.
class VioRos
{
public:
  /// Subscribes and advertises. @throws std::invalid_argument for wrong parameters, CalibrationError for files.
  VioRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~VioRos();
  VioRos(const VioRos&) = delete;
  VioRos& operator=(const VioRos&) = delete;

private:
  using Clock = std::chrono::steady_clock;

  /// All that belongs to one calibration and one time; never changed, replaced as a whole.
  struct Pipeline
  {
    StereoCalibration cameras;
    VioOptions vio_options;
    Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
    double gyro_variance = 0.0;  ///< of a sample [rad^2/s^2]
    std::shared_ptr<Vio> vio;
    std::shared_ptr<Mapper> mapper;  ///< null without mapping; the same after a restart
  };
  using PipelinePtr = std::shared_ptr<const Pipeline>;

  /// What is known of one input topic.
  struct Input
  {
    std::string topic;
    std::atomic<uint64_t> messages{0};
    std::atomic<Clock::rep> came_at{0};
    void note();
    double silentSeconds() const;
  };

  /// A pair and what was seen in it, to be drawn.
  struct Tracks
  {
    PicturePair pair;
    FrameFeatures features;
    std::vector<FrameFeatures> earlier;
  };

  // vio_imu
  void onImu(const sensor_msgs::ImuConstPtr& message);
  void publishOdometry(const Pipeline& pipeline, const PropagatedState& propagated);

  // vio_input
  void onCameraInfo(int camera, const sensor_msgs::CameraInfoConstPtr& info);
  void onImage(int camera, const pi_os_transport::zero_copy::ImageHandle& message);
  void enqueue(std::vector<PicturePair>* pairs);

  // vio_worker
  void work();
  void workOn(const PicturePair& pair, const Pipeline& pipeline, uint64_t generation);
  void warnOf(const FrameReport& report, const PicturePair& pair);
  void keepForPath(const Pipeline& pipeline);
  void showTracks(const PicturePair& pair, const Pipeline& pipeline);

  // vio_output
  void tick();
  void prepare();
  /// Where the sensors are, by parameters or tf. @return false if that is not known yet.
  bool mounting(const std::string& imu_frame, const std::string& left_frame, Eigen::Isometry3d* T_base_body,
                Eigen::Isometry3d* T_body_left);
  bool lookUp(const std::string& parent, const std::string& child, const char* parameter,
              Eigen::Isometry3d* T_parent_child);
  void build(const FileCalibration& calibration, const Eigen::Isometry3d& T_base_body);
  void watchInputs();
  void publishPath();
  void publishPoints();
  void publishTracks(const Tracks& tracks, const CameraModel& left, const CameraModel& right);
  void publishDiagnostics();

  // vio_service
  bool saveMap(SaveMap::Request& request, SaveMap::Response& response);
  bool loadMap(LoadMap::Request& request, LoadMap::Response& response);
  bool reset(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  /// base_link was at the pose at its stamp. By odometry of that stamp where it is still known (5 s), else (stamp 0,
  /// older, newer, or of the time before odometry began anew) by the newest. Of the pose position and heading are
  /// taken; z only if its variance is above 0: rviz's 2D Pose Estimate knows none.
  void onInitialPose(const geometry_msgs::PoseWithCovarianceStampedConstPtr& message);

  /// Any thread: odometry anew, with the same calibration.
  void restart(const std::string& reason, bool forget_map);
  void replacePipeline(PipelinePtr pipeline);
  PipelinePtr pipeline() const;
  std::shared_ptr<Vio> makeVio(const StereoCalibration& cameras, const VioOptions& options,
                               const std::shared_ptr<Mapper>& mapper) const;
  void setProblem(const std::string& problem, bool failed);
  /// The mapper, or why there is none.
  std::shared_ptr<Mapper> mapperFor(const std::string& file, std::string* problem) const;

  pi_node::CallbackThread imu_thread_;
  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread output_thread_;
  pi_node::CallbackThread service_thread_;
  ros::NodeHandle imu_node_;
  ros::NodeHandle input_node_;
  ros::NodeHandle output_node_;
  ros::NodeHandle private_node_;  ///< on vio_service
  const VioRosOptions options_;
  std::shared_ptr<pi_runtime::Runtime> runtime_;  ///< null if nothing uses it
  pi_node::WarningBoard warnings_;
  VioDiagnostics diagnostics_;
  std::optional<FileCalibration> file_calibration_;

  Input imu_input_;
  Input picture_inputs_[2];
  Input info_inputs_[2];

  mutable std::mutex mutex_;  ///< of all below; held briefly
  PipelinePtr pipeline_;
  uint64_t generation_ = 0;  ///< grows when odometry begins anew
  std::deque<PicturePair> pairs_;
  bool stopping_ = false;
  std::condition_variable pairs_changed_;
  std::condition_variable imu_arrived_;
  PairMatcher matcher_;
  uint64_t dropped_pairs_ = 0;
  std::string problem_;
  bool problem_failed_ = false;
  sensor_msgs::CameraInfoConstPtr infos_[2];
  bool infos_changed_ = false;
  std::string imu_frame_;
  std::string left_frame_;
  Eigen::Isometry3d T_map_odom_ = Eigen::Isometry3d::Identity();
  std::optional<Eigen::Matrix4d> map_covariance_;                ///< of MapStatistics; none: not localised in the map
  std::deque<std::pair<int64_t, Eigen::Isometry3d>> odom_path_;  ///< T_odom_body by stamp, of this generation
  PoseHistory odom_history_;                                     ///< T_odom_base as published, of this generation

  std::mutex restart_mutex_;  ///< one at a time replaces the pipeline
  std::atomic<bool> worker_waits_for_imu_{false};
  std::atomic<int64_t> last_imu_ns_{0};       ///< 0: none
  std::atomic<int64_t> last_odometry_ns_{0};  ///< likewise
  std::atomic<int64_t> delay_ns_{0};
  std::atomic<uint64_t> odometries_{0};
  std::atomic<bool> drawing_{false};

  // vio_imu
  int64_t next_tf_ns_ = 0;

  // vio_input
  int64_t last_picture_ns_[2] = {0, 0};  ///< of each camera: one may lag behind the other; 0: none

  // vio_worker
  VioStatus status_ = VioStatus::INITIALIZING;
  bool started_ = false;  ///< there was a pose in this generation
  uint64_t worked_generation_ = 0;
  std::weak_ptr<Mapper> worked_mapper_;
  int pairs_without_stereo_ = 0;
  std::deque<FrameFeatures> earlier_;
  // vio_output
  std::unique_ptr<tf2_ros::Buffer> tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  Clock::time_point waiting_since_ = Clock::now();

  tf2_ros::TransformBroadcaster tf_broadcaster_;
  ros::Publisher odometry_;
  ros::Publisher map_pose_;
  ros::Publisher path_;
  ros::Publisher points_;
  ros::Publisher tracks_;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<ros::ServiceServer> services_;
  std::vector<ros::WallTimer> timers_;
  std::thread worker_;
};

}  // namespace pi_slam
