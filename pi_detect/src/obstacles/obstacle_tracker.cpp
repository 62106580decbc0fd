#include <pi_detect/obstacle_tracker.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <pi_node/option_check.h>
#include "obstacles/carried_outline.h"
#include "obstacles/ground_filter.h"
#include "obstacles/obstacle_labels.h"
#include "obstacles/obstacle_place.h"
#include "obstacles/obstacle_view.h"
#include "tracking/assignment.h"

namespace pi_detect
{

using obstacles::Place;

namespace
{

constexpr int64_t RESTART_NS = 1000000000;
constexpr double GATE = 11.8;       // of the squared Mahalanobis distance, 2 degrees of freedom: 99.7 %
constexpr double SAME_PLACE = 0.5;  // part of the smaller box inside the other: the same, whatever its middle does
constexpr double START_SPEED_SIGMA = 1.5;  // [m/s]
constexpr double SIZE_GAIN = 0.2;          // of a new measurement of the size and of its place's error
constexpr double NARROW_GAIN = 0.1;        // likewise of its width, where one end is not seen
constexpr double STEADY_M = 0.25;          // by which the width of one thing that moves may change on average, ...
constexpr double STEADY_PART = 0.1;        // and this part of it
constexpr double GATE_EDGE_M = 0.3;        // of the middle's uncertainty, counts to tell one obstacle from the next
constexpr double SCALE_ERROR = 0.04;       // of depth: what stands seems to move by this part of the vehicle's speed
constexpr double MOVING_SPEED = 0.4;       // [m/s]
constexpr double MOVING_SIGMAS2 = 9.0;     // squared; slow, low or unsteady things have to be this clear, ...
constexpr double FAST_SPEED = 0.8;         // ... others do not: to know late that a person runs costs more [m/s]
constexpr double FAST_SIGMAS2 = 4.0;
constexpr double PERSON_M = 0.8;        // height of a small child
constexpr int MOVING_HITS = 2;          // measurements one after the other that say so
constexpr double MOVING_AFTER_S = 0.2;  // without a class, of being followed: what appears may be a piece of another
constexpr double SAME_ERROR_S = 1.0;    // for which errors of a place stay about the same: they look like motion
constexpr double GAP_S = 0.3;           // after which what is seen there may be another piece: nothing about motion
constexpr double CROSSING_S = 1.5;      // of somebody who runs across the way at the side of the picture
constexpr double BORDER_PX = 12.0;      // at the picture's sides
constexpr double PERSON_WIDTH_M = 1.0;  // at most
constexpr double PARTED = 0.4;          // of what two things covered together, the ground of one alone
constexpr double PART_INSIDE = 0.8;     // of what is seen, inside the outline that is known

}  // namespace

void ObstacleTrackerOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("time_to_live_s", time_to_live_s, 0.0, 60.0);
  check.range("memory_s", memory_s, 0.0, 600.0);
  check.range("confirm_hits", confirm_hits, 1, 100);
  check.range("acceleration_m_s2", acceleration_m_s2, 0.01, 50.0);
  check.range("max_speed_m_s", max_speed_m_s, 0.1, 100.0);
  footprint.validate();
  check.range("min_label_overlap", min_label_overlap, 0.0, 1.0);
}

class ObstacleTracker::Implementation
{
public:
  explicit Implementation(const ObstacleTrackerOptions& options) : options_(options) { options_.validate(); }

  std::vector<Obstacle> update(int64_t stamp_ns, const VehicleState& vehicle,
                               const std::vector<ObstacleMeasurement>& seen, const std::vector<ObjectTrack>& tracks,
                               const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left, double min_depth_m)
  {
    if (last_ns_ && stamp_ns <= *last_ns_)
    {
      if (*last_ns_ - stamp_ns <= RESTART_NS)
      {
        return last_result_;
      }
      clear();
    }
    setVehicle(vehicle);
    const double dt_s = last_ns_ ? 1e-9 * static_cast<double>(stamp_ns - *last_ns_) : 0.0;
    last_ns_ = stamp_ns;
    for (Known& known : known_)
    {
      predict(stamp_ns, dt_s, &known);
    }
    const std::vector<ObstacleMeasurement> measurements = cutAtBorders(seen, geometry);
    const std::vector<int> track_of = obstacles::chooseTracks(measurements, tracks, options_.min_label_overlap);
    const std::vector<int> known_of = associate(measurements);
    for (size_t i = 0; i < measurements.size(); ++i)
    {
      const ObjectTrack* track = track_of[i] < 0 ? nullptr : &tracks[static_cast<size_t>(track_of[i])];
      if (known_of[i] >= 0)
      {
        correct(stamp_ns, measurements[i], track, geometry, &known_[static_cast<size_t>(known_of[i])]);
      }
      else
      {
        begin(stamp_ns, measurements[i], track);
      }
    }
    forget(stamp_ns, obstacles::ObstacleView(measurements, geometry, T_base_left, min_depth_m));
    last_result_ = report(vehicle);
    return last_result_;
  }

  void clear()
  {
    known_.clear();
    last_result_.clear();
    last_ns_.reset();
  }

private:
  /// A tracked obstacle. Its position is the middle of the side that faces the vehicle; the box lies behind it.
  struct Known
  {
    explicit Known(obstacles::GroundFilter start) : filter(std::move(start)) {}

    int64_t id = 0;
    obstacles::GroundFilter filter;
    Eigen::Vector2d size = Eigen::Vector2d::Zero();
    obstacles::CarriedOutline outline;  ///< by the filter's position
    double z_low = 0.0;
    double z_high = 0.0;
    Eigen::Matrix2d place_covariance = Eigen::Matrix2d::Zero();  ///< mean of the measurements, in odom
    Eigen::Vector2d seen_at = Eigen::Vector2d::Zero();           ///< estimate at the last measurement, in odom
    Eigen::Matrix2d seen_covariance = Eigen::Matrix2d::Zero();   ///< to find it there again
    bool held = false;              ///< not seen for GAP_S, without known motion: stays where it was
    int64_t followed_since_ns = 0;  ///< without a break: what is known of its velocity is from then on
    int hits = 0;
    double unsteady_m = 0.0;  ///< mean change of the width: large where pieces of several things come and go
    int moving_hits = 0;      ///< one after the other in which it moved
    int class_id = -1;
    float score = 0.0F;
    int64_t track_id = -1;
    int64_t first_seen_ns = 0;
    int64_t last_seen_ns = 0;
  };

  void setVehicle(const VehicleState& vehicle)
  {
    const Eigen::Matrix3d R = vehicle.T_odom_base.linear();
    // The ground plane of odom and base_link are taken as parallel: only the heading turns.
    const double heading = std::atan2(R(1, 0), R(0, 0));
    vehicle_.R_odom_base = Eigen::Rotation2Dd(heading).toRotationMatrix();
    vehicle_.p_odom_base = vehicle.T_odom_base.translation().head<2>();
    vehicle_velocity_ = vehicle_.R_odom_base * vehicle.velocity.head<2>();
  }

  OutlineBounds footprintOf(const Known& known) const
  {
    if (known.held && !known.outline.empty())
    {
      // Its size was measured along axes that have turned since.
      return boundsOf(known.outline.at(known.filter.position(), vehicle_));
    }
    const Eigen::Vector2d place = vehicle_.toBase(known.filter.position());
    const Eigen::Vector2d half(0.0, 0.5 * known.size.y());
    return {place - half, place + half + Eigen::Vector2d(known.size.x(), 0.0)};
  }

  static bool isMoving(const Known& known) { return known.moving_hits >= MOVING_HITS; }

  static double followedS(const Known& known)
  {
    return 1e-9 * static_cast<double>(known.last_seen_ns - known.followed_since_ns);
  }

  bool isSignificant(const Known& known, double sigmas2 = FAST_SIGMAS2) const
  {
    const Eigen::Vector2d v = known.filter.velocity();
    const bool runs = v.norm() > FAST_SPEED && known.z_high > PERSON_M;
    const double clear = runs ? sigmas2 : MOVING_SIGMAS2;
    return v.norm() > MOVING_SPEED && v.dot(velocityCovariance(known).inverse() * v) > clear;
  }

  /// An obstacle that is not seen keeps moving if its motion is significant, but not longer than it was tracked or
  /// crossing the way takes. Others
  /// stay where they were seen last: with an uncertain velocity they could be anywhere after memory_s, and would be
  /// associated with other obstacles.
  void predict(int64_t stamp_ns, double dt_s, Known* known) const
  {
    if (known->held)
    {
      return;
    }
    known->filter.predict(dt_s, options_.acceleration_m_s2, options_.max_speed_m_s);
    const double unseen_s = 1e-9 * static_cast<double>(stamp_ns - known->last_seen_ns);
    const bool goes_on =
        isMoving(*known) && isSignificant(*known) && unseen_s <= std::max(CROSSING_S, followedS(*known));
    if (unseen_s > GAP_S && !goes_on)
    {
      const bool moved = isMoving(*known);
      known->filter.restart(moved ? known->filter.position() : known->seen_at,
                            moved ? known->filter.positionCovariance() : known->seen_covariance, startSpeedSigma());
      known->moving_hits = 0;
      known->held = true;
    }
  }

  /// @return known obstacle of each measurement, or -1.
  std::vector<int> associate(const std::vector<ObstacleMeasurement>& measurements) const
  {
    Eigen::MatrixXd cost(static_cast<Eigen::Index>(measurements.size()), static_cast<Eigen::Index>(known_.size()));
    for (size_t i = 0; i < measurements.size(); ++i)
    {
      const OutlineBounds measured = obstacles::footprintOf(measurements[i]);
      for (size_t k = 0; k < known_.size(); ++k)
      {
        const Place place = obstacles::placeOf(measurements[i], known_[k].size, vehicle_, GATE_EDGE_M);
        const double distance2 = known_[k].filter.distance2(place.position, place.covariance);
        const double common = obstacles::commonPart(measured, footprintOf(known_[k]));
        const Eigen::Vector2d size = measured.high - measured.low;
        const double unlike = (size - known_[k].size).norm() / (0.5 + size.norm() + known_[k].size.norm());
        double value = 2.0 * GATE;
        if (distance2 < GATE)
        {
          // The negative logarithm of the likelihood: what could be anywhere explains little.
          value = distance2 + std::log((known_[k].filter.positionCovariance() + place.covariance).determinant());
        }
        else if (common > SAME_PLACE)
        {
          value = GATE;
        }
        cost(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = value + 4.0 * unlike - 4.0 * common;
      }
    }
    return assign(cost, 1.5 * GATE);
  }

  void begin(int64_t stamp_ns, const ObstacleMeasurement& measurement, const ObjectTrack* track)
  {
    const Eigen::Vector2d size = (measurement.max - measurement.min).head<2>();
    const Place place = obstacles::placeOf(measurement, size, vehicle_);
    Known known(obstacles::GroundFilter(place.position, place.covariance, startSpeedSigma()));
    known.id = ++last_id_;
    known.size = size;
    known.place_covariance = place.covariance;
    known.first_seen_ns = known.followed_since_ns = stamp_ns;
    known.seen_at = place.position;
    known.seen_covariance = obstacles::placeOf(measurement, size, vehicle_, GATE_EDGE_M).covariance;
    known.z_low = measurement.min.z();
    known.z_high = measurement.max.z();
    known.outline.take(stamp_ns, measurement.outline, vehicle_, place.position);
    see(stamp_ns, track, &known);
    known_.push_back(known);
  }

  double startSpeedSigma() const { return std::min(START_SPEED_SIGMA, options_.max_speed_m_s); }

  static bool reachesLeft(const ObstacleMeasurement& measurement, const StereoGeometry& geometry)
  {
    // The left margin of the left picture has no partner in the right one.
    const double margin = geometry.fx * geometry.baseline_m / std::max(0.1, measurement.nearest.x());
    return measurement.box.x1 < margin + BORDER_PX;
  }

  static bool reachesRight(const ObstacleMeasurement& measurement, const StereoGeometry& geometry)
  {
    return measurement.box.x2 > geometry.width - BORDER_PX;
  }

  /// Ends at the picture's sides are cut.
  static std::vector<ObstacleMeasurement> cutAtBorders(std::vector<ObstacleMeasurement> measurements,
                                                       const StereoGeometry& geometry)
  {
    for (ObstacleMeasurement& measurement : measurements)
    {
      measurement.cut_left = measurement.cut_left || reachesLeft(measurement, geometry);
      measurement.cut_right = measurement.cut_right || reachesRight(measurement, geometry);
    }
    return measurements;
  }

  /// What becomes wider behind the one end that is seen has its middle elsewhere, but has not moved. Nor has what was
  /// taken for wider than it is, as a piece of its neighbour was seen with it.
  /// @return by how much, in odom.
  Eigen::Vector2d widen(const ObstacleMeasurement& measurement, Known* known) const
  {
    const double wider = measurement.max.y() - measurement.min.y() - known->size.y();
    const double more = wider > 0.0 ? wider : NARROW_GAIN * wider;
    const Eigen::Vector2d by =
        vehicle_.R_odom_base * Eigen::Vector2d(0.0, measurement.cut_left ? 0.5 * more : -0.5 * more);
    known->filter.shift(by);
    known->size.y() += more;
    return by;
  }

  /// Whether it stands, and the picture's border leaves a part of it: the ends of that part are those of the view,
  /// which moves on with the vehicle. Of a person, one end tells enough.
  bool isRest(const ObstacleMeasurement& measurement, const Known& known) const
  {
    const bool person = obstacles::showsOneEnd(measurement) && known.size.maxCoeff() < PERSON_WIDTH_M;
    if (known.held || isMoving(known) || person || known.outline.empty() || known.hits < options_.confirm_hits)
    {
      return false;
    }
    const OutlineBounds rest = obstacles::footprintOf(measurement);
    const OutlineBounds whole = boundsOf(known.outline.at(known.seen_at, vehicle_));
    return rest.size().prod() < whole.size().prod() && obstacles::commonPart(rest, whole) > PART_INSIDE;
  }

  /// Whether it is a person's size and was taken for a piece of what stands behind it: what is known is the whole's.
  bool isParted(const ObstacleMeasurement& measurement, const Known& known) const
  {
    const OutlineBounds part = obstacles::footprintOf(measurement);
    return !isMoving(known) && !measurement.cut_left && !measurement.cut_right && !measurement.piece &&
           part.size().maxCoeff() < PERSON_WIDTH_M && measurement.max.z() > PERSON_M &&
           part.size().prod() < PARTED * footprintOf(known).size().prod();
  }

  /// What was known of the whole goes, but for its id and class.
  void startAnew(const ObstacleMeasurement& measurement, Known* known) const
  {
    known->size = (measurement.max - measurement.min).head<2>();
    const Place place = obstacles::placeOf(measurement, known->size, vehicle_);
    known->place_covariance = place.covariance;
    known->unsteady_m = 0.0;
    known->held = true;
  }

  void correct(int64_t stamp_ns, const ObstacleMeasurement& measurement, const ObjectTrack* track,
               const StereoGeometry& geometry, Known* known)
  {
    if (isParted(measurement, *known))
    {
      startAnew(measurement, known);
    }
    const bool cut = measurement.cut_left || measurement.cut_right;
    if (cut && isRest(measurement, *known))
    {
      known->filter.moveTo(known->seen_at, known->place_covariance);
      known->followed_since_ns = stamp_ns;
      known->moving_hits = 0;
      see(stamp_ns, track, known);
      return;
    }
    const bool one_end = obstacles::showsOneEnd(measurement);
    // If the obstacle did not move, only its visible part has changed: the outline stays in place.
    const Eigen::Vector2d expected = known->filter.position();
    const Eigen::Vector2d widened = one_end ? widen(measurement, known) : Eigen::Vector2d::Zero();
    const Place place = obstacles::placeOf(measurement, known->size, vehicle_);
    known->place_covariance += SIZE_GAIN * (place.covariance - known->place_covariance);
    const Place narrow = obstacles::placeOf(measurement, known->size, vehicle_, GATE_EDGE_M);
    const bool anew = known->held;
    bool stays = cut && !(one_end && isMoving(*known));
    if (known->held || known->filter.distance2(narrow.position, narrow.covariance) > GATE)
    {
      known->filter.restart(place.position, place.covariance, startSpeedSigma());
      known->followed_since_ns = stamp_ns;
      known->held = false;
      stays = true;
    }
    else if (!one_end && (reachesLeft(measurement, geometry) || reachesRight(measurement, geometry)))
    {
      // The visible part of a wall moves with the view: its ends do not show motion.
      known->filter.moveTo(place.position, place.covariance);
      known->followed_since_ns = isMoving(*known) ? known->followed_since_ns : stamp_ns;
      stays = true;
    }
    else
    {
      known->filter.correct(place.position, place.covariance);
    }
    const Eigen::Vector2d position = known->filter.position();
    if (anew)
    {
      known->outline.take(stamp_ns, measurement.outline, vehicle_, position);
    }
    else
    {
      const Eigen::Vector2d moved = stays ? Eigen::Vector2d(position - expected) : widened;
      known->outline.correct(stamp_ns, measurement.outline, vehicle_, position, moved, cut);
    }
    const Eigen::Vector3d size = measurement.max - measurement.min;
    known->size.x() += SIZE_GAIN * (size.x() - known->size.x());
    if (!one_end)
    {
      known->unsteady_m += SIZE_GAIN * (std::abs(size.y() - known->size.y()) - known->unsteady_m);
      const double gain_y = cut && size.y() < known->size.y() ? 0.25 * SIZE_GAIN : SIZE_GAIN;
      known->size.y() += gain_y * (size.y() - known->size.y());
    }
    known->z_low += SIZE_GAIN * (measurement.min.z() - known->z_low);
    known->z_high += SIZE_GAIN * (measurement.max.z() - known->z_high);
    known->seen_at = known->filter.position();
    known->seen_covariance = narrow.covariance;
    see(stamp_ns, track, known);
    const bool steady =
        known->unsteady_m < STEADY_M + STEADY_PART * known->size.y() || isSignificant(*known, MOVING_SIGMAS2);
    const bool long_enough = known->class_id >= 0 || followedS(*known) > MOVING_AFTER_S;
    const bool tells = isMoving(*known) || (long_enough && !measurement.piece);
    known->moving_hits = steady && tells && isSignificant(*known) ? known->moving_hits + 1 : 0;
  }

  static void see(int64_t stamp_ns, const ObjectTrack* track, Known* known)
  {
    ++known->hits;
    known->last_seen_ns = stamp_ns;
    if (track != nullptr)
    {
      known->class_id = track->class_id;
      known->score = track->score;
      known->track_id = track->id;
    }
  }

  /// Covariance of the velocity, plus errors that stay the same for a while and so look like motion.
  Eigen::Matrix2d velocityCovariance(const Known& known) const
  {
    const double same_s = std::clamp(followedS(known), 0.1, SAME_ERROR_S);
    // Depth that is wrong by a constant part looks like motion along the vehicle's own.
    const Eigen::Vector2d scale_sigma = SCALE_ERROR * vehicle_velocity_;
    return known.filter.velocityCovariance() + known.place_covariance / (same_s * same_s) +
           scale_sigma * scale_sigma.transpose();
  }

  void forget(int64_t stamp_ns, const obstacles::ObstacleView& view)
  {
    const auto isOver = [&](Known& known)
    {
      if (known.last_seen_ns == stamp_ns)
      {
        return false;
      }
      const double unseen_s = 1e-9 * static_cast<double>(stamp_ns - known.last_seen_ns);
      if (known.hits < options_.confirm_hits)
      {
        return unseen_s > 0.5 * options_.time_to_live_s;
      }
      if (unseen_s > options_.memory_s + options_.time_to_live_s)
      {
        return true;
      }
      return unseen_s > options_.time_to_live_s && !keepHidden(view, &known);
    };
    known_.erase(std::remove_if(known_.begin(), known_.end(), isOver), known_.end());
  }

  /// Removes the part that should be visible. @return false if nothing is left.
  bool keepHidden(const obstacles::ObstacleView& view, Known* known) const
  {
    const Eigen::Vector2d place = vehicle_.toBase(known->filter.position());
    const double z = 0.5 * (known->z_low + known->z_high);
    if (view.isExposed({place.x(), place.y(), z}))
    {
      return false;
    }
    if (known->outline.empty())
    {
      return true;
    }
    const Eigen::Vector2d position = known->filter.position();
    Outline hidden = view.hiddenPart(known->outline.at(position, vehicle_), z);
    limitCorners(&hidden);
    known->outline.take(known->last_seen_ns, hidden, vehicle_, position);
    return !hidden.empty();
  }

  std::vector<Obstacle> report(const VehicleState& vehicle) const
  {
    std::vector<Obstacle> result;
    for (const Known& known : known_)
    {
      if (known.hits >= options_.confirm_hits)
      {
        result.push_back(describe(known, vehicle));
      }
    }
    std::stable_sort(result.begin(), result.end(),
                     [](const Obstacle& a, const Obstacle& b) { return a.distance_m < b.distance_m; });
    return result;
  }

  Obstacle describe(const Known& known, const VehicleState& vehicle) const
  {
    const Eigen::Matrix2d R_base_odom = vehicle_.R_odom_base.transpose();
    const OutlineBounds box = footprintOf(known);
    Obstacle obstacle;
    obstacle.id = known.id;
    obstacle.class_id = known.class_id;
    obstacle.score = known.score;
    obstacle.track_id = known.track_id;
    obstacle.first_seen_ns = known.first_seen_ns;
    obstacle.last_seen_ns = known.last_seen_ns;
    obstacle.position << 0.5 * (box.low + box.high), 0.5 * (known.z_low + known.z_high);
    obstacle.size << box.size(), known.z_high - known.z_low;
    obstacle.outline = known.outline.at(known.filter.position(), vehicle_);
    obstacle.position_covariance.topLeftCorner<2, 2>() =
        R_base_odom * known.filter.positionCovariance() * R_base_odom.transpose();
    obstacle.position_covariance(2, 2) = obstacle.position_covariance.topLeftCorner<2, 2>().maxCoeff();

    const Eigen::Vector2d v_base = R_base_odom * known.filter.velocity();
    const Eigen::Vector2d v_vehicle = vehicle.velocity.head<2>();
    const Eigen::Matrix2d v_covariance = R_base_odom * velocityCovariance(known) * R_base_odom.transpose();
    obstacle.velocity << v_base, 0.0;
    obstacle.velocity_covariance.topLeftCorner<2, 2>() = v_covariance;
    obstacle.moving = isMoving(known) && known.size.maxCoeff() < obstacles::BULKY_M;

    const Eigen::Vector2d outside = box.low.cwiseMax(-box.high).cwiseMax(0.0);
    obstacle.distance_m = outside.norm();
    const Eigen::Vector2d v_relative = (obstacle.moving ? v_base : Eigen::Vector2d::Zero().eval()) - v_vehicle;
    obstacle.time_to_collision_s = timeToCollision(obstacle.position.head<2>(), v_relative, 0.5 * box.size(), options_);
    return obstacle;
  }

  const ObstacleTrackerOptions options_;
  obstacles::VehiclePlace vehicle_;
  Eigen::Vector2d vehicle_velocity_ = Eigen::Vector2d::Zero();  ///< in odom
  std::vector<Known> known_;
  std::vector<Obstacle> last_result_;
  std::optional<int64_t> last_ns_;
  int64_t last_id_ = 0;
};

ObstacleTracker::ObstacleTracker(const ObstacleTrackerOptions& options)
  : implementation_(std::make_unique<Implementation>(options))
{
}

ObstacleTracker::~ObstacleTracker() = default;

std::vector<Obstacle> ObstacleTracker::update(int64_t stamp_ns, const VehicleState& vehicle,
                                              const std::vector<ObstacleMeasurement>& measurements,
                                              const std::vector<ObjectTrack>& tracks, const StereoGeometry& geometry,
                                              const Eigen::Isometry3d& T_base_left, double min_depth_m)
{
  return implementation_->update(stamp_ns, vehicle, measurements, tracks, geometry, T_base_left, min_depth_m);
}

void ObstacleTracker::clear()
{
  implementation_->clear();
}

}  // namespace pi_detect
