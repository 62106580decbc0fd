#include "decision/pose_keeper.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle
{

using pi_node::format;
using pi_node::seconds;

namespace
{

constexpr double TIME_JUMP_S = 0.5;  // stamps that go back by more reset the keeper
constexpr double WHEELS_KEPT_S = 10.0;
constexpr double MAP_AGE_S = 1.0;           // oldest pose in the map to start from
constexpr double SAME_LIFE_S = 30.0;        // a vehicle with an older saved pose was switched off
constexpr double LEAST_RATE_HZ = 20.0;      // of odometry
constexpr double CHECKED_WAY_M = 1.0;       // over which wheels and odometry are compared
constexpr double STANDS = 0.05;             // [m/s]
constexpr double LONGEST_DRIVE_ON_S = 1.0;  // until a vehicle without localisation brakes
constexpr double EXACT_M = 0.05;            // for odometry that was sent no pose
constexpr double EXACT_RAD = 0.02;
constexpr double NOTHING_KNOWN = 1e-6;  // T_map_odom this near to the identity is unknown
constexpr int MANY_TRIES = 10;

double squared(double value)
{
  return value * value;
}

double headingOf(const Eigen::Isometry3d& T)
{
  return std::atan2(T.linear()(1, 0), T.linear()(0, 0));
}

double headingBetween(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return std::abs(wrapAngle(headingOf(a) - headingOf(b)));
}

double distanceOnGround(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b)
{
  return (a.translation() - b.translation()).head<2>().norm();
}

Eigen::Isometry3d lifted(const Pose2& pose)
{
  return Eigen::Translation3d(pose.x, pose.y, 0.0) * Eigen::AngleAxisd(pose.heading, Eigen::Vector3d::UnitZ());
}

bool knowsNothing(const Eigen::Isometry3d& T_map_odom)
{
  return (T_map_odom.matrix() - Eigen::Matrix4d::Identity()).norm() < NOTHING_KNOWN;
}

bool isPose(const Eigen::Isometry3d& T)
{
  const Eigen::Matrix3d R = T.linear();
  return T.matrix().allFinite() && (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3;
}

}  // namespace

void PoseKeeperOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("silence_s", silence_s, 0.05, 5.0);
  check.range("jump_distance", jump_distance, 0.1, 10.0);
  check.range("jump_heading", jump_heading, 0.05, 3.0);
  check.range("jump_per_m", jump_per_m, 0.0, 1.0);
  check.range("agreement", agreement, 0.05, 10.0);
  check.range("agreement_heading", agreement_heading, 0.01, 3.0);
  check.range("retry_s", retry_s, 0.05, 10.0);
  check.range("max_position_deviation", max_position_deviation, 0.1, 100.0);
  check.range("position_deviation", position_deviation, 0.001, 10.0);
  check.range("heading_deviation", heading_deviation, 0.001, 3.0);
  check.range("distance_error", distance_error, 0.0, 1.0);
  check.range("heading_error", heading_error, 0.0, 1.0);
  check.range("wheel_timeout_s", wheel_timeout_s, 0.05, 5.0);
  check.range("wheel_disagreement", wheel_disagreement, 0.01, 1.0);
}

const char* toString(KeeperState state)
{
  static constexpr const char* NAMES[] = {"waiting", "localised", "silent", "restoring", "lost"};
  return NAMES[static_cast<size_t>(state)];
}

PoseKeeper::PoseKeeper(const PoseKeeperOptions& options)
  : options_((options.validate(), options)), wheels_(options.fastest(), WHEELS_KEPT_S)
{
}

void PoseKeeper::set(KeeperState state, const std::string& reason)
{
  state_ = state;
  reason_ = reason;
}

/// The clock jumped: the kept poses are of no use.
void PoseKeeper::forget()
{
  wheels_.clear();
  last_.reset();
  map_.reset();
  anchor_.reset();
  check_.reset();
  doubt_ns_.reset();
  saved_.reset();
  set(KeeperState::WAITING, "time went back; waits for odometry's place in map");
}

bool PoseKeeper::addWheels(int64_t stamp_ns, const Pose2& pose, double speed, double yaw_rate)
{
  if (!pose.finite() || !std::isfinite(speed) || !std::isfinite(yaw_rate))
  {
    return false;
  }
  const WheelTrack::Point* newest = wheels_.newest();
  if (newest != nullptr && seconds(newest->stamp_ns - stamp_ns) > TIME_JUMP_S)
  {
    wheels_.clear();
    check_.reset();
    if (anchor_)
    {
      anchor_->wheels.reset();
    }
  }
  wheels_.add(stamp_ns, pose, speed, yaw_rate);
  if (anchor_ && !anchor_->wheels && wheels_.covers(anchor_->pose.stamp_ns))
  {
    anchor_->wheels = wheels_.at(anchor_->pose.stamp_ns, 0.0);
  }
  return true;
}

void PoseKeeper::addMapTransform(int64_t stamp_ns, const Eigen::Isometry3d& T_map_odom)
{
  if (isPose(T_map_odom) && (!map_ || stamp_ns >= map_->stamp_ns))
  {
    map_ = MapTransform{stamp_ns, T_map_odom};
  }
}

/// Whether the vehicle cannot have moved so.
bool PoseKeeper::isJump(const Eigen::Isometry3d& moved, int64_t from_ns, int64_t to_ns, double speed) const
{
  const auto from = wheels_.at(from_ns, options_.wheel_timeout_s);
  const auto to = wheels_.at(to_ns, options_.wheel_timeout_s);
  if (from && to && wheelsTrusted())
  {
    const Pose2 rolled = from->pose.inverse() * to->pose;
    const double more = options_.jump_per_m * (to->distance - from->distance);
    return distanceOnGround(moved, lifted(rolled)) > options_.jump_distance + more ||
           headingBetween(moved, lifted(rolled)) > options_.jump_heading + more;
  }
  // Since then the vehicle may have kept its speed, braked or accelerated.
  const double possible = std::max(std::abs(speed), options_.fastest()) * seconds(to_ns - from_ns);
  return moved.translation().head<2>().norm() > options_.jump_distance + possible;
}

bool PoseKeeper::beganAnew(const OdometryPose& odometry) const
{
  const bool elsewhere = odometry.connection != last_->connection;
  if (elsewhere && odometry.count < last_->count)
  {
    return true;
  }
  const bool silent = seconds(odometry.stamp_ns - last_->stamp_ns) > options_.silence_s;
  return (elsewhere || silent) &&
         isJump(last_->T_odom_base.inverse() * odometry.T_odom_base, last_->stamp_ns, odometry.stamp_ns, last_->speed);
}

void PoseKeeper::beginRestoring(int64_t stamp_ns, const std::string& reason)
{
  ++restarts_;
  life_ns_ = stamp_ns;
  tries_ = 0;
  doubt_ns_.reset();
  check_.reset();
  if (anchor_)
  {
    set(KeeperState::RESTORING, reason);
  }
}

std::string PoseKeeper::addOdometry(const OdometryPose& odometry, int64_t now_ns)
{
  if (!isPose(odometry.T_odom_base) || !std::isfinite(odometry.speed))
  {
    return "odometry is not finite, or its orientation is none; left out";
  }
  if (last_ && odometry.connection < last_->connection)
  {
    return "two publishers give odometry; the one that came last is believed. End one of them";
  }
  if (last_ && odometry.stamp_ns <= last_->stamp_ns)
  {
    if (seconds(last_->stamp_ns - odometry.stamp_ns) <= TIME_JUMP_S)
    {
      return "";
    }
    forget();
  }
  if (last_ && beganAnew(odometry))
  {
    beginRestoring(odometry.stamp_ns, "odometry began anew; is told where it is");
  }
  else if (last_ && odometry.connection != last_->connection && state_ != KeeperState::RESTORING)
  {
    doubt_ns_ = odometry.stamp_ns;
  }
  last_ = odometry;
  last_came_ns_ = now_ns;
  switch (state_)
  {
    case KeeperState::WAITING:
      followFirst();
      break;
    case KeeperState::LOCALISED:
    case KeeperState::SILENT:
      if (doubt_ns_)
      {
        settleDoubt();
      }
      else
      {
        follow("odometry knows");
      }
      break;
    case KeeperState::RESTORING:
    case KeeperState::LOST:
      confirm();
      break;
  }
  checkWheels();
  return "";
}

/// The vehicle is where odometry says.
void PoseKeeper::follow(const std::string& reason)
{
  Anchor anchor;
  anchor.pose = {last_->stamp_ns, odometryInMap(), options_.position_deviation, options_.heading_deviation};
  anchor.speed = last_->speed;
  if (wheels_.covers(last_->stamp_ns))
  {
    anchor.wheels = wheels_.at(last_->stamp_ns, 0.0);
  }
  anchor_ = anchor;
  set(KeeperState::LOCALISED, reason);
}

/// The first message: accepted, unless a saved pose contradicts.
void PoseKeeper::followFirst()
{
  if (!map_ || std::abs(seconds(map_->stamp_ns - last_->stamp_ns)) > MAP_AGE_S)
  {
    set(KeeperState::WAITING, "tf has no place of odometry in map yet; does the localisation publish it?");
    return;
  }
  if (!saved_)
  {
    follow("odometry knows");
    return;
  }
  const SavedPose saved = *saved_;
  saved_.reset();
  // Whether odometry went on since then: by its count, else by where the vehicle can have come meanwhile.
  const double reach = options_.jump_distance + options_.fastest() * saved.age_s;
  const bool counted = last_->count > 0 && saved.count > 0;
  const bool same_life = counted
                             ? static_cast<double>(last_->count) >= saved.count + LEAST_RATE_HZ * saved.age_s
                             : saved.age_s < SAME_LIFE_S && distanceOnGround(odometryInMap(), saved.T_map_base) < reach;
  if (!knowsNothing(map_->T_map_odom) || same_life)
  {
    follow("odometry knows; the saved pose was not needed");
    return;
  }
  Anchor anchor;
  const double braking = squared(saved.speed) / (2.0 * options_.limits.deceleration);
  const double driven = std::abs(saved.speed) < STANDS ? 0.0 : std::abs(saved.speed) * LONGEST_DRIVE_ON_S + braking;
  anchor.pose = {last_->stamp_ns, saved.T_map_base, options_.position_deviation + driven,
                 options_.heading_deviation + options_.jump_per_m * driven};
  anchor_ = anchor;
  beginRestoring(last_->stamp_ns, "goes on from the saved pose, " + format("%.0f", saved.age_s) + " s old");
}

/// Odometry comes over another connection, and is continuous: of another life it is if its place in map is not.
void PoseKeeper::settleDoubt()
{
  if (!mapIsOf(*doubt_ns_) || !anchor_)
  {
    set(KeeperState::SILENT, "odometry comes over another connection; waits for its place in map");
    return;
  }
  const Eigen::Isometry3d moved = anchor_->pose.T_map_base.inverse() * odometryInMap();
  if (isJump(moved, anchor_->pose.stamp_ns, last_->stamp_ns, anchor_->speed))
  {
    beginRestoring(*doubt_ns_, "odometry began anew; is told where it is");
    return;
  }
  doubt_ns_.reset();
  follow("odometry knows");
}

/// Whether odometry that began anew knows where it is.
void PoseKeeper::confirm()
{
  if (!mapIsOf(life_ns_))
  {
    return;
  }
  const bool told_otherwise = !knowsNothing(map_->T_map_odom);
  if (state_ == KeeperState::LOST)
  {
    if (told_otherwise)
    {
      follow("odometry was told, or recognised a place");
    }
    return;
  }
  const KeptPose kept = carried(last_->stamp_ns);
  const double distance = distanceOnGround(kept.T_map_base, odometryInMap());
  const double heading = headingBetween(kept.T_map_base, odometryInMap());
  const bool exact = distance < EXACT_M && heading < EXACT_RAD;
  const double beyond = std::max(0.0, kept.position_deviation - options_.position_deviation);
  const bool agrees = distance < options_.agreement + beyond && heading < options_.agreement_heading + beyond;
  if (exact || (told_otherwise && agrees))
  {
    follow(tries_ > 0 ? "odometry was told where it is" : "odometry began anew and knows where it is");
  }
}

std::optional<KeptPose> PoseKeeper::update(int64_t now_ns)
{
  const bool silent = !last_ || seconds(now_ns - last_came_ns_) > options_.silence_s;
  if (silent)
  {
    if (state_ == KeeperState::LOCALISED || state_ == KeeperState::SILENT)
    {
      set(KeeperState::SILENT, "odometry is silent; the wheels carry the pose on");
    }
    return std::nullopt;
  }
  if (state_ != KeeperState::RESTORING || !mapIsOf(life_ns_) ||
      (tries_ > 0 && seconds(now_ns - tried_ns_) < options_.retry_s))
  {
    return std::nullopt;
  }
  // At a time known to both odometry and wheels.
  int64_t stamp_ns = last_->stamp_ns;
  if (const WheelTrack::Point* wheels = wheels_.newest())
  {
    if (seconds(stamp_ns - wheels->stamp_ns) < options_.wheel_timeout_s)
    {
      stamp_ns = std::min(stamp_ns, wheels->stamp_ns);
    }
    if (stamp_ns < life_ns_)
    {
      return std::nullopt;  // they will
    }
  }
  const KeptPose kept = carried(stamp_ns);
  if (kept.position_deviation > options_.max_position_deviation)
  {
    set(KeeperState::LOST, "odometry began anew, and the place is known to " + format("%.1f", kept.position_deviation) +
                               " m only (max_position_deviation = " + format("%.1f", options_.max_position_deviation) +
                               "); give the pose on initialpose, as rviz does by 2D Pose Estimate");
    return std::nullopt;
  }
  ++tries_;
  ++told_;
  tried_ns_ = now_ns;
  if (tries_ == MANY_TRIES)
  {
    reason_ = "odometry does not take the pose that it is told; does it subscribe initialpose, in this frame?";
  }
  return kept;
}

KeptPose PoseKeeper::carried(int64_t stamp_ns) const
{
  KeptPose kept = anchor_->pose;
  double unknown_s = seconds(stamp_ns - kept.stamp_ns);
  double speed = anchor_->speed;
  kept.stamp_ns = stamp_ns;
  const auto from = anchor_->wheels ? anchor_->wheels : wheels_.at(anchor_->pose.stamp_ns, options_.wheel_timeout_s);
  const WheelTrack::Point* newest = wheels_.newest();
  if (from && newest != nullptr)
  {
    const auto reached = wheels_.at(stamp_ns, options_.wheel_timeout_s);
    const WheelTrack::Point to = reached ? *reached : *newest;
    const double way = std::max(0.0, to.distance - from->distance);
    const double error = wheelsTrusted() ? options_.distance_error : std::max(options_.distance_error, wheel_error_);
    const double turned = options_.heading_error * way;
    kept.T_map_base = kept.T_map_base * lifted(from->pose.inverse() * to.pose);
    // A heading error moves the position sideways, at most by the way driven.
    kept.position_deviation =
        std::sqrt(squared(kept.position_deviation) + squared(error * way) + squared(0.5 * turned * way));
    kept.heading_deviation = std::hypot(kept.heading_deviation, turned);
    unknown_s = reached ? 0.0 : seconds(stamp_ns - newest->stamp_ns);
    speed = to.speed;
  }
  if (unknown_s > 0.0 && std::abs(speed) >= STANDS)
  {
    const double driven =
        std::abs(speed) * std::min(unknown_s, LONGEST_DRIVE_ON_S) +
        (unknown_s > LONGEST_DRIVE_ON_S ? squared(speed) / (2.0 * options_.limits.deceleration) : 0.0);
    kept.position_deviation += driven;
    kept.heading_deviation += options_.jump_per_m * driven;
  }
  return kept;
}

/// Compares wheels and odometry over each metre.
void PoseKeeper::checkWheels()
{
  const auto wheels =
      state_ == KeeperState::LOCALISED ? wheels_.at(last_->stamp_ns, options_.wheel_timeout_s) : std::nullopt;
  if (!wheels)
  {
    check_.reset();
    return;
  }
  if (!check_)
  {
    check_ = WheelCheck{last_->T_odom_base, *wheels};
    return;
  }
  const Eigen::Isometry3d moved = check_->T_odom_base.inverse() * last_->T_odom_base;
  const double way = std::max(moved.translation().head<2>().norm(), wheels->distance - check_->wheels.distance);
  if (way >= CHECKED_WAY_M)
  {
    const Pose2 rolled = check_->wheels.pose.inverse() * wheels->pose;
    const double error = (moved.translation().head<2>() - rolled.position()).norm();
    wheel_error_ = std::max(error, headingBetween(moved, lifted(rolled))) / way;
    check_ = WheelCheck{last_->T_odom_base, *wheels};
  }
}

std::optional<KeptPose> PoseKeeper::pose() const
{
  if (!anchor_ || state_ == KeeperState::LOST)
  {
    return std::nullopt;
  }
  const WheelTrack::Point* wheels = wheels_.newest();
  const bool later = wheels != nullptr && wheels->stamp_ns > anchor_->pose.stamp_ns;
  return state_ == KeeperState::LOCALISED || !later ? anchor_->pose : carried(wheels->stamp_ns);
}

std::optional<SavedPose> PoseKeeper::toSave() const
{
  const std::optional<KeptPose> kept = pose();
  if (!kept || kept->position_deviation > options_.max_position_deviation)
  {
    return std::nullopt;
  }
  const WheelTrack::Point* wheels = wheels_.newest();
  const bool by_wheels = state_ != KeeperState::LOCALISED && wheels != nullptr;
  SavedPose saved;
  saved.T_map_base = kept->T_map_base;
  saved.speed = by_wheels ? wheels->speed : anchor_->speed;
  saved.count = last_ ? last_->count : 0;
  return saved;
}

}  // namespace pi_vehicle
