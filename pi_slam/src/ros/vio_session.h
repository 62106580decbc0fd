#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_node/vehicle_clock.h>

#include <Eigen/Geometry>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "odometry/pose_history.h"
#include "ros/pair_matcher.h"
#include "ros/vio_diagnostics.h"
#include "ros/vio_pipeline.h"

namespace pi_slam
{

/// The odometry that runs now: its pipeline, the pairs that wait for it and the poses kept of it. All of it is replaced
/// at once when odometry starts again. Any thread may call any method; no lock is held while work is done.
class VioSession
{
public:
  /// A pair for the worker.
  struct Work
  {
    PicturePair pair;
    VioPipeline::Ptr pipeline;  ///< null from take(): odometry has begun anew since the pair came
    uint64_t generation = 0;    ///< grows when odometry begins anew
    bool covered = false;       ///< the IMU reaches over the pair's stamp
  };
  struct Problem
  {
    std::string text;     ///< why there can be no odometry; empty: there can
    bool failed = false;  ///< it is an error, not something to wait for
  };
  /// Where odometry is or was, for a pose from outside.
  struct Place
  {
    VioPipeline::Ptr pipeline;
    uint64_t generation = 0;
    Eigen::Isometry3d T_map_odom = Eigen::Isometry3d::Identity();
    std::optional<Eigen::Isometry3d> T_odom_base;  ///< at the stamp asked for
    std::optional<std::pair<int64_t, Eigen::Isometry3d>> newest_odom_base;
  };

  using Path = std::vector<std::pair<int64_t, Eigen::Isometry3d>>;
  struct MapPlace
  {
    Eigen::Isometry3d T_map_odom = Eigen::Isometry3d::Identity();
    std::optional<Eigen::Matrix4d> covariance;     ///< of MapStatistics; nullopt: not localised in the map
    std::optional<Eigen::Isometry3d> T_earth_map;  ///< likewise; nullopt: not known
  };

  /// The arguments outlive it.
  VioSession(const VioRosOptions& options, VioPipeline::RuntimePtr runtime, pi_node::WarningBoard* warnings,
             VioDiagnostics* diagnostics);

  VioPipeline::Ptr pipeline() const;
  /// @return whether there was one before.
  bool replace(VioPipeline::Ptr pipeline);
  /// Restarts odometry with the same calibration, if there is one.
  void restart(const std::string& reason, bool forget_map);
  /// Why there is no odometry. Logs it: an error at once, what to wait for after input_timeout_s. One thread.
  void setProblem(const std::string& problem, bool failed);
  Problem problem() const;

  // Pictures and pairs.
  /// Matches a picture of a pipeline; without effect if that has been replaced.
  /// @param frame  of the message. @return as PairMatcher::takeMismatch().
  std::optional<double> addPicture(const VioPipeline::Ptr& pipeline, int camera, int64_t stamp_ns,
                                   const cv::Mat& picture, const std::string& frame);
  /// Forgets the pictures and pairs that wait.
  void clearPairs();
  /// Waits for a pair, then for the IMU to reach over it, at most as `waits` says. @return nullopt after stop().
  /// @param waits  called before it waits for the IMU to reach a pair; returns until when, of vehicleNs().
  std::optional<Work> take(const std::function<int64_t()>& waits);
  /// To be called after each IMU sample.
  void imuArrived();
  void stop();

  // Poses.
  void addOdometry(const VioPipeline& pipeline, int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base);
  /// After work on a pair: takes T_map_odom of the pipeline's mapper.
  void updateMapPlace(const VioPipeline& pipeline, uint64_t generation);
  /// After a pose was set: takes T_map_odom of the mapper, or this one without a mapper.
  void setMapPlace(const Place& place, const Eigen::Isometry3d& T_map_odom);
  MapPlace mapPlace() const;
  Place placeAt(int64_t stamp_ns) const;
  void keepForPath(uint64_t generation, int64_t stamp_ns, const Eigen::Isometry3d& T_odom_body);
  Path odomPathInMap() const;  ///< T_map_body by stamp
  std::string leftFrame() const;

  /// Queues and counts, for the diagnostics.
  void fill(VioFigures* figures) const;

  std::atomic<int64_t> last_imu_ns{0};       ///< stamp; 0: none
  std::atomic<int64_t> last_odometry_ns{0};  ///< likewise
  std::atomic<int64_t> delay_ns{0};          ///< of the newest pair behind the IMU

private:
  bool replaceLocked(VioPipeline::Ptr pipeline);

  const VioRosOptions& options_;
  const VioPipeline::RuntimePtr runtime_;
  pi_node::WarningBoard* const warnings_;
  VioDiagnostics* const diagnostics_;
  int64_t waiting_since_ns_ = pi_node::vehicleNs();  ///< of the thread of setProblem()

  std::mutex restart_mutex_;  ///< one at a time replaces the pipeline
  std::atomic<bool> worker_waits_for_imu_{false};
  int64_t silent_since_ns_ = -1;  ///< stamp of the sample after which a pair waited in vain; -1: none
  std::condition_variable pairs_changed_;
  std::condition_variable imu_arrived_;
  mutable std::mutex mutex_;  ///< of all below; held briefly
  VioPipeline::Ptr pipeline_;
  uint64_t generation_ = 0;
  bool stopping_ = false;
  Problem problem_;
  PairMatcher matcher_;
  std::deque<Work> pairs_;
  uint64_t dropped_pairs_ = 0;
  std::string left_frame_;
  MapPlace map_place_;
  PoseHistory history_{5000000000, 4000000};  ///< T_odom_base as published: 5 s, for poses that are set later
  std::deque<Path::value_type> path_;         ///< T_odom_body
};

}  // namespace pi_slam
