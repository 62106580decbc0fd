#pragma once

#include "decision/wheel_track.h"

#include <pi_node/vehicle_description.h>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>

namespace pi_vehicle
{

struct PoseKeeperOptions
{
  double silence_s = 0.2;               ///< of odometry, after which the wheels carry the pose on [s]
  double jump_distance = 0.5;           ///< of odometry against the wheels over a silence: it began anew [m]
  double jump_heading = 0.2;            ///< likewise [rad]
  double jump_per_m = 0.1;              ///< more of both per metre driven meanwhile [m/m, rad/m]
  double agreement = 0.3;               ///< odometry's pose in map and the kept one are the same [m]
  double agreement_heading = 0.08;      ///< likewise [rad]
  double retry_s = 0.3;                 ///< between two tries to tell odometry where it is [s]
  double max_position_deviation = 1.0;  ///< one sigma beyond which the pose counts as lost [m]

  double position_deviation = 0.05;  ///< of odometry's pose, one sigma [m]
  double heading_deviation = 0.01;   ///< likewise [rad]
  double distance_error = 0.03;      ///< of the wheels, of the way driven, one sigma
  double heading_error = 0.01;       ///< likewise [rad/m]
  double wheel_timeout_s = 0.3;      ///< silence of the wheels after which they do not know [s]
  double wheel_disagreement = 0.2;   ///< with odometry, of the way, beyond which the wheels are not believed
  pi_node::MotionLimits limits;      ///< of the vehicle; a vehicle of which nothing is heard brakes as usual

  /// What is faster is a jump [m/s].
  double fastest() const { return limits.speed + 1.0; }

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// One message of odometry.
struct OdometryPose
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_odom_base = Eigen::Isometry3d::Identity();
  double speed = 0.0;       ///< [m/s]
  uint64_t connection = 0;  ///< a later connection has a larger number
  uint32_t count = 0;       ///< messages since the publisher started; 0: not counted
};

/// Where base_link is in map, one sigma each.
struct KeptPose
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  double position_deviation = 0.0;  ///< [m]
  double heading_deviation = 0.0;   ///< [rad]
};

/// The pose that an earlier run wrote.
struct SavedPose
{
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  double speed = 0.0;  ///< at that time [m/s]
  uint32_t count = 0;  ///< of odometry's messages then; 0: not counted
  double age_s = 0.0;  ///< [s]
};

enum class KeeperState
{
  WAITING,    ///< for odometry and its place in map
  LOCALISED,  ///< odometry knows where the vehicle is
  SILENT,     ///< odometry is silent, or its pose is not accepted yet
  RESTORING,  ///< odometry restarted and is sent its pose
  LOST        ///< odometry restarted, and the pose is unknown
};
/// "waiting", "localised", ...
const char* toString(KeeperState state);

/// Keeps the vehicle's pose in the map while odometry restarts, which it does at its own origin.
///
/// While odometry runs, the pose is T_map_odom T_odom_base; while it is silent, wheel odometry continues the pose.
/// Odometry counts as restarted if
/// - it comes over another connection, and its count of messages went back; or
/// - it comes over another connection or after silence_s, and its pose jumped: against the wheels by more than
///   jump_*, or without trusted wheels by more than the vehicle can have driven; or
/// - it comes over another connection, and its pose in the map jumped in this way.
/// A jump of T_map_odom alone is a loop closure and is accepted. Restarted odometry is sent its pose until it reports
/// the same pose; if it does so by itself, because its map knows the place, nothing is sent. When stamps go back by
/// more than 0.5 s, the keeper forgets everything and trusts odometry.
///
/// All times are on one clock. Not thread safe.
class PoseKeeper
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit PoseKeeper(const PoseKeeperOptions& options = PoseKeeperOptions());

  /// Call before the first message. Odometry without a place in the map (T_map_odom is the identity) that cannot be the
  /// one of the saved pose is sent the saved pose.
  void resume(const SavedPose& saved) { saved_ = saved; }

  /// @return why it was left out, and the way out; empty: it was not.
  std::string addOdometry(const OdometryPose& odometry, int64_t now_ns);
  void addMapTransform(int64_t stamp_ns, const Eigen::Isometry3d& T_map_odom);
  /// @return false: left out, as numbers are not finite.
  bool addWheels(int64_t stamp_ns, const Pose2& pose, double speed, double yaw_rate);

  /// Call at 20 Hz or more. @return a pose to send to odometry.
  std::optional<KeptPose> update(int64_t now_ns);

  KeeperState state() const { return state_; }
  bool valid() const { return state_ == KeeperState::LOCALISED; }
  const std::string& reason() const { return reason_; }  ///< in words
  /// The best known pose, at the newest stamp; nullopt: unknown.
  std::optional<KeptPose> pose() const;
  /// The pose to save, with age 0; nullopt: unknown.
  std::optional<SavedPose> toSave() const;

  size_t restarts() const { return restarts_; }  ///< of odometry
  size_t told() const { return told_; }          ///< poses, in all
  /// Recent difference between wheels and odometry, as a fraction of the way.
  double wheelDisagreement() const { return wheel_error_; }
  bool wheelsTrusted() const { return wheel_error_ <= options_.wheel_disagreement; }

private:
  struct Anchor
  {
    KeptPose pose;
    double speed = 0.0;
    std::optional<WheelTrack::Point> wheels;  ///< at the stamp of the pose
  };
  struct MapTransform
  {
    int64_t stamp_ns = 0;
    Eigen::Isometry3d T_map_odom = Eigen::Isometry3d::Identity();
  };

  void forget();
  bool isJump(const Eigen::Isometry3d& moved, int64_t from_ns, int64_t to_ns, double speed) const;
  bool beganAnew(const OdometryPose& odometry) const;
  void beginRestoring(int64_t stamp_ns, const std::string& reason);
  void follow(const std::string& reason);
  void followFirst();
  void settleDoubt();
  void confirm();
  void checkWheels();
  /// The anchor, moved on by the wheels.
  KeptPose carried(int64_t stamp_ns) const;
  void set(KeeperState state, const std::string& reason);
  bool mapIsOf(int64_t stamp_ns) const { return map_ && map_->stamp_ns >= stamp_ns; }
  Eigen::Isometry3d odometryInMap() const { return map_->T_map_odom * last_->T_odom_base; }

  const PoseKeeperOptions options_;
  WheelTrack wheels_;
  std::optional<OdometryPose> last_;
  int64_t last_came_ns_ = 0;
  std::optional<MapTransform> map_;
  std::optional<Anchor> anchor_;
  std::optional<SavedPose> saved_;

  KeeperState state_ = KeeperState::WAITING;
  std::string reason_ = "nothing came from odometry yet; does the localisation run?";
  std::optional<int64_t> doubt_ns_;  ///< stamp of the first message over another connection
  int64_t life_ns_ = 0;              ///< RESTORING, LOST: stamp of the first message of odometry that began anew
  int tries_ = 0;
  int64_t tried_ns_ = 0;
  size_t restarts_ = 0;
  size_t told_ = 0;

  struct WheelCheck
  {
    Eigen::Isometry3d T_odom_base;
    WheelTrack::Point wheels;
  };
  std::optional<WheelCheck> check_;
  double wheel_error_ = 0.0;
};

}  // namespace pi_vehicle
