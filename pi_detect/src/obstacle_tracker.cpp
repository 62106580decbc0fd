#include "pi_detect/obstacle_tracker.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "obstacles/ground_filter.h"
#include "pi_detect/assignment.h"
#include "pi_runtime/option_check.h"

namespace pi_detect
{

namespace
{

constexpr int64_t RESTART_NS = 1000000000;
constexpr double GATE = 11.8;       // of the squared Mahalanobis distance, 2 degrees of freedom: 99.7 %
constexpr double SAME_PLACE = 0.5;  // part of the smaller box inside the other: the same, whatever its middle does
constexpr double START_SPEED_SIGMA = 1.5;  // [m/s]
constexpr double SIZE_GAIN = 0.2;          // of a new measurement of the size
constexpr double STEADY_M = 0.25;          // by which the width of one thing that moves may change on average, ...
constexpr double STEADY_PART = 0.1;        // and this part of it
constexpr double GATE_EDGE_M = 0.3;        // of the middle's uncertainty, counts to tell one obstacle from the next
constexpr double EDGE_PART = 0.06;    // of its extent by which a box's middle may be wrong: seen from another side, ...
constexpr double CUT_PART = 0.25;     // likewise where one end is not seen
constexpr double SCALE_ERROR = 0.04;  // of depth: what stands seems to move by this part of the vehicle's speed
constexpr double MOVING_SIGMAS2 = 9.0;  // squared
constexpr double MOVING_SPEED = 0.4;    // [m/s]
constexpr int MOVING_HITS = 4;          // measurements one after the other that say so
constexpr double SAME_ERROR_S = 1.0;    // for which errors of a place stay about the same: they look like motion
constexpr double GAP_S = 0.3;           // after which what is seen there may be another piece: nothing about motion
constexpr double BULKY_M = 5.0;         // the middle of longer things says nothing about motion
constexpr double BORDER_PX = 12.0;      // at the picture's sides
constexpr double SAME_DEPTH_M = 1.5;    // of the pieces of one labelled object

/// What a measurement says about an obstacle's place, in base_link: the middle of the side that faces the vehicle.
struct Place
{
  Eigen::Vector2d position;
  Eigen::Matrix2d covariance;
};

/// Box on the ground.
struct Footprint
{
  Eigen::Vector2d low;
  Eigen::Vector2d high;

  double area() const { return (high - low).cwiseMax(0.05).prod(); }
};

double commonPart(const Footprint& a, const Footprint& b)
{
  const Eigen::Vector2d size = a.high.cwiseMin(b.high) - a.low.cwiseMax(b.low);
  if (size.minCoeff() <= 0.0)
  {
    return 0.0;
  }
  return size.cwiseMax(0.05).prod() / std::min(a.area(), b.area());
}

Footprint footprintOf(const ObstacleMeasurement& measurement)
{
  return {measurement.min.head<2>(), measurement.max.head<2>()};
}

}  // namespace

void ObstacleTrackerOptions::validate() const
{
  const pi_runtime::OptionCheck check("");
  check.range("time_to_live_s", time_to_live_s, 0.0, 60.0);
  check.range("memory_s", memory_s, 0.0, 600.0);
  check.range("confirm_hits", confirm_hits, 1, 100);
  check.range("acceleration_m_s2", acceleration_m_s2, 0.01, 50.0);
  check.range("max_speed_m_s", max_speed_m_s, 0.1, 100.0);
  check.range("min_depth_m", min_depth_m, 0.0, 20.0);
  check.range("vehicle_front_m", vehicle_front_m, 0.0, 20.0);
  check.range("vehicle_rear_m", vehicle_rear_m, 0.0, 20.0);
  check.range("vehicle_half_width_m", vehicle_half_width_m, 0.05, 10.0);
  check.range("min_label_overlap", min_label_overlap, 0.0, 1.0);
}

class ObstacleTracker::Implementation
{
public:
  explicit Implementation(const ObstacleTrackerOptions& options) : options_(options) { options_.validate(); }

  std::vector<Obstacle> update(int64_t stamp_ns, const VehicleState& vehicle,
                               const std::vector<ObstacleMeasurement>& measurements,
                               const std::vector<ObjectTrack>& tracks, const StereoGeometry& geometry,
                               const Eigen::Isometry3d& T_base_left)
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
    const std::vector<int> track_of = chooseTracks(measurements, tracks);
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
    forget(stamp_ns, measurements, geometry, T_base_left);
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
  /// An obstacle that is followed. Its place is the middle of the side that faces the vehicle; the box lies behind it.
  struct Known
  {
    explicit Known(obstacles::GroundFilter start) : filter(std::move(start)) {}

    int64_t id = 0;
    obstacles::GroundFilter filter;
    Eigen::Vector2d size = Eigen::Vector2d::Zero();
    double z_low = 0.0;
    double z_high = 0.0;
    Eigen::Matrix2d place_covariance = Eigen::Matrix2d::Zero();  ///< of the last measurement, in odom
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
    R_odom_base_ = Eigen::Rotation2Dd(heading).toRotationMatrix();
    p_odom_base_ = vehicle.T_odom_base.translation().head<2>();
    vehicle_speed_ = vehicle.velocity.head<2>().norm();
  }

  Eigen::Vector2d toBase(const Eigen::Vector2d& p_odom) const
  {
    return R_odom_base_.transpose() * (p_odom - p_odom_base_);
  }

  Footprint footprintOf(const Known& known) const
  {
    const Eigen::Vector2d place = toBase(known.filter.position());
    const Eigen::Vector2d half(0.0, 0.5 * known.size.y());
    return {place - half, place + half + Eigen::Vector2d(known.size.x(), 0.0)};
  }

  static bool isMoving(const Known& known) { return known.moving_hits >= MOVING_HITS; }

  bool isSignificant(const Known& known) const
  {
    const Eigen::Vector2d v = known.filter.velocity();
    return v.norm() > MOVING_SPEED && v.dot(velocityCovariance(known).inverse() * v) > MOVING_SIGMAS2;
  }

  /// What is not seen goes on as long as it is known to move; else it stays where it was seen last: a velocity that may
  /// as well be none takes it anywhere in memory_s, and its growing uncertainty takes hold of other things.
  void predict(int64_t stamp_ns, double dt_s, Known* known) const
  {
    if (known->held)
    {
      return;
    }
    known->filter.predict(dt_s, options_.acceleration_m_s2, options_.max_speed_m_s);
    const bool gap = 1e-9 * static_cast<double>(stamp_ns - known->last_seen_ns) > GAP_S;
    if (gap && !(isMoving(*known) && isSignificant(*known)))
    {
      const bool moved = isMoving(*known);
      known->filter.restart(moved ? known->filter.position() : known->seen_at,
                            moved ? known->filter.positionCovariance() : known->seen_covariance, startSpeedSigma());
      known->moving_hits = 0;
      known->held = true;
    }
  }

  /// @param known_size   of the obstacle so far, along the axes of base_link.
  /// @param most_edge_m  bound for what is added for ends that are not seen or have changed.
  Place placeOf(const ObstacleMeasurement& measurement, const Eigen::Vector2d& known_size,
                double most_edge_m = 10.0) const
  {
    const Eigen::Vector2d size = (measurement.max - measurement.min).head<2>();
    const double width = known_size.y();
    const bool cut = measurement.cut_left || measurement.cut_right;
    Place place;
    place.position = {measurement.min.x(), 0.5 * (measurement.min.y() + measurement.max.y())};
    if (measurement.cut_left != measurement.cut_right && width > size.y())
    {
      place.position.y() = measurement.cut_left ? measurement.min.y() + 0.5 * width : measurement.max.y() - 0.5 * width;
    }
    // When a piece joins or leaves, the middle moves by half of what the width changes, the near end of a side that is
    // seen at an angle by as much as the length. A cut end may be the near one.
    Eigen::Vector2d edge_sigma = EDGE_PART * size;
    if (cut)
    {
      edge_sigma = CUT_PART * size.cwiseMax(known_size);
    }
    edge_sigma += 0.5 * (size - known_size).cwiseAbs();
    edge_sigma = edge_sigma.cwiseMin(most_edge_m);
    const double depth_sigma = EDGE_PART * std::min(BULKY_M, size.y());
    place.covariance = measurement.covariance.topLeftCorner<2, 2>();
    place.covariance(0, 0) += depth_sigma * depth_sigma;
    place.covariance.diagonal() += edge_sigma.cwiseAbs2();
    place.position = R_odom_base_ * place.position + p_odom_base_;
    place.covariance = R_odom_base_ * place.covariance * R_odom_base_.transpose();
    return place;
  }

  /// @return known obstacle of each measurement, or -1.
  std::vector<int> associate(const std::vector<ObstacleMeasurement>& measurements) const
  {
    Eigen::MatrixXd cost(static_cast<Eigen::Index>(measurements.size()), static_cast<Eigen::Index>(known_.size()));
    for (size_t i = 0; i < measurements.size(); ++i)
    {
      const Footprint measured = pi_detect::footprintOf(measurements[i]);
      for (size_t k = 0; k < known_.size(); ++k)
      {
        const Place place = placeOf(measurements[i], known_[k].size, GATE_EDGE_M);
        const double distance2 = known_[k].filter.distance2(place.position, place.covariance);
        const double common = commonPart(measured, footprintOf(known_[k]));
        const Eigen::Vector2d size = measured.high - measured.low;
        const double unlike = (size - known_[k].size).norm() / (0.5 + size.norm() + known_[k].size.norm());
        double value = 2.0 * GATE;
        if (distance2 < GATE)
        {
          value = distance2;
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
    const Place place = placeOf(measurement, size);
    Known known(obstacles::GroundFilter(place.position, place.covariance, startSpeedSigma()));
    known.id = ++last_id_;
    known.size = size;
    known.place_covariance = place.covariance;
    known.first_seen_ns = known.followed_since_ns = stamp_ns;
    known.seen_at = place.position;
    known.seen_covariance = placeOf(measurement, size, GATE_EDGE_M).covariance;
    known.z_low = measurement.min.z();
    known.z_high = measurement.max.z();
    see(stamp_ns, track, &known);
    known_.push_back(known);
  }

  double startSpeedSigma() const { return std::min(START_SPEED_SIGMA, options_.max_speed_m_s); }

  static bool reachesBorder(const ObstacleMeasurement& measurement, const StereoGeometry& geometry)
  {
    // The left margin of the left picture has no partner in the right one.
    const double margin = geometry.fx * geometry.baseline_m / std::max(0.1, measurement.nearest.x());
    return measurement.box.x1 < margin + BORDER_PX || measurement.box.x2 > geometry.width - BORDER_PX;
  }

  void correct(int64_t stamp_ns, const ObstacleMeasurement& measurement, const ObjectTrack* track,
               const StereoGeometry& geometry, Known* known)
  {
    const Place place = placeOf(measurement, known->size);
    known->place_covariance = place.covariance;
    const Place narrow = placeOf(measurement, known->size, GATE_EDGE_M);
    if (known->held || known->filter.distance2(narrow.position, narrow.covariance) > GATE)
    {
      known->filter.restart(place.position, place.covariance, startSpeedSigma());
      known->followed_since_ns = stamp_ns;
      known->held = false;
    }
    else if (reachesBorder(measurement, geometry))
    {
      // What of a wall is seen moves with the view: its ends say nothing about motion.
      known->filter.moveTo(place.position, place.covariance);
      known->followed_since_ns = isMoving(*known) ? known->followed_since_ns : stamp_ns;
    }
    else
    {
      known->filter.correct(place.position, place.covariance);
    }
    const bool cut = measurement.cut_left || measurement.cut_right;
    const Eigen::Vector3d size = measurement.max - measurement.min;
    const double gain_y = cut && size.y() < known->size.y() ? 0.25 * SIZE_GAIN : SIZE_GAIN;
    known->unsteady_m += SIZE_GAIN * (std::abs(size.y() - known->size.y()) - known->unsteady_m);
    known->size.x() += SIZE_GAIN * (size.x() - known->size.x());
    known->size.y() += gain_y * (size.y() - known->size.y());
    known->z_low += SIZE_GAIN * (measurement.min.z() - known->z_low);
    known->z_high += SIZE_GAIN * (measurement.max.z() - known->z_high);
    known->seen_at = known->filter.position();
    known->seen_covariance = narrow.covariance;
    see(stamp_ns, track, known);
    const bool steady = known->unsteady_m < STEADY_M + STEADY_PART * known->size.y();
    known->moving_hits = steady && isSignificant(*known) ? known->moving_hits + 1 : 0;
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

  /// With what errors that stay the same for a while may look like.
  Eigen::Matrix2d velocityCovariance(const Known& known) const
  {
    const double followed_s = 1e-9 * static_cast<double>(known.last_seen_ns - known.followed_since_ns);
    const double same_s = std::clamp(followed_s, 0.1, SAME_ERROR_S);
    // Depth that is wrong by a constant part looks like motion as the vehicle comes nearer.
    const double scale_sigma = SCALE_ERROR * vehicle_speed_;
    return known.filter.velocityCovariance() + known.place_covariance / (same_s * same_s) +
           scale_sigma * scale_sigma * Eigen::Matrix2d::Identity();
  }

  /// The detector's track of each measurement, or -1. A track's box may hold several pieces of its object, but not what
  /// stands behind.
  std::vector<int> chooseTracks(const std::vector<ObstacleMeasurement>& measurements,
                                const std::vector<ObjectTrack>& tracks) const
  {
    std::vector<int> chosen(measurements.size(), -1);
    std::vector<float> best_overlap(measurements.size(), 0.0F);
    for (size_t t = 0; t < tracks.size(); ++t)
    {
      std::optional<size_t> main;
      float largest = 0.0F;
      const auto fits = [&](size_t i)
      {
        const float common = intersection(measurements[i].box, tracks[t].box);
        return common > 0.0F && common >= options_.min_label_overlap * measurements[i].box.area();
      };
      for (size_t i = 0; i < measurements.size(); ++i)
      {
        const float common = intersection(measurements[i].box, tracks[t].box);
        if (fits(i) && common > largest)
        {
          largest = common;
          main = i;
        }
      }
      for (size_t i = 0; main && i < measurements.size(); ++i)
      {
        const double step = measurements[i].nearest.head<2>().norm() - measurements[*main].nearest.head<2>().norm();
        const float same = overlap(measurements[i].box, tracks[t].box);
        if (fits(i) && std::abs(step) < SAME_DEPTH_M && same > best_overlap[i])
        {
          best_overlap[i] = same;
          chosen[i] = static_cast<int>(t);
        }
      }
    }
    return chosen;
  }

  void forget(int64_t stamp_ns, const std::vector<ObstacleMeasurement>& measurements, const StereoGeometry& geometry,
              const Eigen::Isometry3d& T_base_left)
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
      return unseen_s > options_.time_to_live_s && isExposed(known, measurements, geometry, T_base_left);
    };
    known_.erase(std::remove_if(known_.begin(), known_.end(), isOver), known_.end());
  }

  /// It should be seen: inside the picture, and nothing measured lies before it.
  bool isExposed(const Known& known, const std::vector<ObstacleMeasurement>& measurements,
                 const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left) const
  {
    const Eigen::Vector2d place = toBase(known.filter.position());
    const Eigen::Vector3d p_base(place.x(), place.y(), 0.5 * (known.z_low + known.z_high));
    const Eigen::Vector3d p = T_base_left.inverse() * p_base;
    if (p.z() < std::max(1e-3, options_.min_depth_m))
    {
      return false;
    }
    const double u = geometry.fx * p.x() / p.z() + geometry.cx;
    const double v = geometry.fy * p.y() / p.z() + geometry.cy;
    // What is left of this has no partner in the right picture.
    const double left = geometry.fx * geometry.baseline_m / p.z();
    if (u < left || u >= geometry.width || v < 0.0 || v >= geometry.height)
    {
      return false;
    }
    return std::none_of(measurements.begin(), measurements.end(),
                        [&](const ObstacleMeasurement& other)
                        {
                          return other.box.x1 <= u && u <= other.box.x2 && other.box.y1 <= v && v <= other.box.y2 &&
                                 other.nearest.head<2>().norm() < 0.9 * p_base.head<2>().norm();
                        });
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
    const Eigen::Matrix2d R_base_odom = R_odom_base_.transpose();
    const Footprint box = footprintOf(known);
    Obstacle obstacle;
    obstacle.id = known.id;
    obstacle.class_id = known.class_id;
    obstacle.score = known.score;
    obstacle.track_id = known.track_id;
    obstacle.first_seen_ns = known.first_seen_ns;
    obstacle.last_seen_ns = known.last_seen_ns;
    obstacle.position << 0.5 * (box.low + box.high), 0.5 * (known.z_low + known.z_high);
    obstacle.size << known.size, known.z_high - known.z_low;
    obstacle.position_covariance.topLeftCorner<2, 2>() =
        R_base_odom * known.filter.positionCovariance() * R_base_odom.transpose();
    obstacle.position_covariance(2, 2) = obstacle.position_covariance.topLeftCorner<2, 2>().maxCoeff();

    const Eigen::Vector2d v_base = R_base_odom * known.filter.velocity();
    const Eigen::Vector2d v_vehicle = vehicle.velocity.head<2>();
    const Eigen::Matrix2d v_covariance = R_base_odom * velocityCovariance(known) * R_base_odom.transpose();
    obstacle.velocity << v_base, 0.0;
    obstacle.velocity_covariance.topLeftCorner<2, 2>() = v_covariance;
    obstacle.moving = isMoving(known) && known.size.maxCoeff() < BULKY_M;

    const Eigen::Vector2d outside = box.low.cwiseMax(-box.high).cwiseMax(0.0);
    obstacle.distance_m = outside.norm();
    const Eigen::Vector2d v_relative = (obstacle.moving ? v_base : Eigen::Vector2d::Zero().eval()) - v_vehicle;
    obstacle.time_to_collision_s = timeToCollision(obstacle.position.head<2>(), v_relative, 0.5 * known.size, options_);
    return obstacle;
  }

  const ObstacleTrackerOptions options_;
  Eigen::Matrix2d R_odom_base_ = Eigen::Matrix2d::Identity();
  Eigen::Vector2d p_odom_base_ = Eigen::Vector2d::Zero();
  double vehicle_speed_ = 0.0;
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
                                              const Eigen::Isometry3d& T_base_left)
{
  return implementation_->update(stamp_ns, vehicle, measurements, tracks, geometry, T_base_left);
}

void ObstacleTracker::clear()
{
  implementation_->clear();
}

}  // namespace pi_detect
