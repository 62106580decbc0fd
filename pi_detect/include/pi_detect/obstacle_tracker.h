#pragma once

#include <pi_detect/object_tracker.h>
#include <pi_detect/outline.h>
#include <pi_detect/stereo_obstacles.h>
#include <pi_node/vehicle_description.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace pi_detect
{

struct ObstacleTrackerOptions
{
  double time_to_live_s = 0.6;     ///< an obstacle in view that was not measured for longer ends [s]
  double memory_s = 3.0;           ///< an obstacle that left the view is kept for this time [s]
  int confirm_hits = 3;            ///< measurements before an obstacle is reported
  double acceleration_m_s2 = 1.0;  ///< of obstacles, standard deviation [m/s^2]
  double max_speed_m_s = 15.0;     ///< of obstacles [m/s]
  pi_node::Footprint footprint;    ///< of the vehicle, for the time to collision
  double min_label_overlap = 0.5;  ///< part of the obstacle's picture box inside a track's box, to take its label

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A tracked obstacle, in base_link at the stamp of the update.
struct Obstacle
{
  int64_t id = 0;  ///< from 1; never used again by this tracker
  int class_id = -1;
  float score = 0.0F;
  int64_t track_id = -1;                               ///< of the ObjectTrack it was seen with last
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< centre of its box [m]
  Eigen::Vector3d size = Eigen::Vector3d::Zero();      ///< along the axes of base_link [m]
  Outline outline;                                     ///< on the ground [m]; empty: only the box is known
  Eigen::Matrix3d position_covariance = Eigen::Matrix3d::Zero();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< over the ground, in the axes of base_link [m/s]
  Eigen::Matrix3d velocity_covariance = Eigen::Matrix3d::Zero();
  bool moving = false;
  double distance_m = 0.0;  ///< from the origin of base_link to the box, on the ground plane [m]
  double time_to_collision_s = std::numeric_limits<double>::infinity();
  int64_t first_seen_ns = 0;
  int64_t last_seen_ns = 0;
};

/// Motion of the vehicle at a stamp.
struct VehicleState
{
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< of base_link in its own axes [m/s]
};

/// Tracks obstacles in odom: Kalman filter with constant velocity on the ground plane, optimal assignment, labels from
/// the detector's tracks. Outlines do not turn with the vehicle. If a part of a remembered outline should be in view
/// but is not measured, the part is removed. Not thread safe.
class ObstacleTracker
{
public:
  explicit ObstacleTracker(const ObstacleTrackerOptions& options = ObstacleTrackerOptions());
  ~ObstacleTracker();
  ObstacleTracker(const ObstacleTracker&) = delete;
  ObstacleTracker& operator=(const ObstacleTracker&) = delete;

  /// @param tracks  of the left rectified picture at (about) this stamp; may be empty.
  /// @param geometry, T_base_left  of the camera, to tell which obstacles should be in view.
  /// @param min_depth_m  along its axis; nearer obstacles cannot be measured, see StereoObstacles::minDepth().
  /// @return confirmed obstacles, nearest first. For a stamp that is not newer, the last result; if time goes back by
  ///         more than 1 s, tracking begins anew.
  std::vector<Obstacle> update(int64_t stamp_ns, const VehicleState& vehicle,
                               const std::vector<ObstacleMeasurement>& measurements,
                               const std::vector<ObjectTrack>& tracks, const StereoGeometry& geometry,
                               const Eigen::Isometry3d& T_base_left, double min_depth_m = 0.0);

  void clear();

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// Time until a box at p, moving with v (both relative to the vehicle, in base_link), touches the vehicle's outline; 0
/// if it does already, infinite if it never does.
double timeToCollision(const Eigen::Vector2d& p, const Eigen::Vector2d& v, const Eigen::Vector2d& half_size,
                       const ObstacleTrackerOptions& options);

}  // namespace pi_detect
