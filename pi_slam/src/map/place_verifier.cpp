#include "map/place_verifier.h"

#include <pi_slam/so3.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "estimator/factors.h"

namespace pi_slam::map
{

namespace
{

/// Descriptors of different things differ in 128 bits, with a deviation of 8: one of 10^10 pairs is below 75, and a
/// first search compares 10^5. Where a feature is near its place as well, several are tried for each.
constexpr int MAX_DISTANCE = 75;                ///< of descriptors, in the first search [bits]
constexpr int MAX_GUIDED_DISTANCE = 70;         ///< near the place where the feature must be
constexpr double GUIDED_PX = 9.0;               ///< radius of that search: 10 cm off in the first pose at 5 m
constexpr double SEARCH_NOISE = 1.6;            ///< of the first search, in units of the noise: its poses are rough
constexpr double MAX_CHI2 = 9.5;                ///< of an inlier: 95 % of four degrees of freedom
constexpr size_t MOST_MATCHES = 160;            ///< in the search, the nearest ones by descriptor
constexpr int ROUNDS = 3;                       ///< of refinement and guided matching
constexpr int STEPS = 6;                        ///< of Gauss-Newton per round
constexpr double MIN_INVERSE_DISTANCE = 0.004;  ///< for the search by points [1/m]
constexpr double POSITION_FLOOR_M = 0.01;       ///< what errors that all matches share leave
constexpr double HEADING_FLOOR_RAD = 0.001;

/// Deterministic random numbers (Marsaglia 2003, xorshift).
class Random
{
public:
  size_t below(size_t bound)
  {
    state_ ^= state_ << 13;
    state_ ^= state_ >> 7;
    state_ ^= state_ << 17;
    return static_cast<size_t>(state_ % bound);
  }

private:
  uint64_t state_ = 0x9E3779B97F4A7C15ULL;
};

Eigen::Matrix3d turnZ(double angle)
{
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

}  // namespace

/// A feature of the map and one of the picture.
struct PlaceVerifier::Match
{
  uint32_t query = 0;
  int distance = 0;           ///< of descriptors
  Eigen::Vector3d origin;     ///< of the map's ray, in map
  Eigen::Vector3d direction;  ///< of it, unit, in map
  double inverse_distance;    ///< along it
  double inverse_deviation;
  double estimate;                      ///< inverse distance that fits both sides
  Eigen::Vector3d bearing;              ///< in the picture, unit, in the odom frame's axes
  Eigen::Matrix<double, 3, 2> tangent;  ///< plane at the bearing
  double noise;                         ///< of the bearing [rad]
  double query_inverse_distance;
  double query_inverse_deviation;
  bool inlier = false;
};

/// Pose of the picture: R_map_odom and the position of the camera.
struct PlaceVerifier::Pose
{
  Eigen::Matrix3d R_map_odom = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_map_camera = Eigen::Vector3d::Zero();

  /// Squared error of a match, given that its distance is uncertain: 3 degrees of freedom.
  /// @param scale  of the bearing's noise.
  double chi2(const Match& match, double scale) const
  {
    const Eigen::Vector3d offset = match.origin - p_map_camera;
    const Eigen::Vector3d point = match.direction + match.inverse_distance * offset;
    const double length = point.norm();
    if (length < 1e-6)
    {
      return 1e9;
    }
    const Eigen::Vector3d u = R_map_odom.transpose() * point / length;
    if (u.dot(match.bearing) < 0.5)
    {
      return 1e9;
    }
    const Eigen::Vector2d error = match.tangent.transpose() * u;
    const Eigen::Vector2d along =
        match.tangent.transpose() * (R_map_odom.transpose() * offset) * (match.inverse_deviation / length);
    const double variance = scale * scale * match.noise * match.noise;
    const double product = error.dot(along);
    const double bearing_part = (error.squaredNorm() - product * product / (variance + along.squaredNorm())) / variance;
    const double difference = match.inverse_distance / length - match.query_inverse_distance;
    return bearing_part + difference * difference /
                              (match.query_inverse_deviation * match.query_inverse_deviation +
                               match.inverse_deviation * match.inverse_deviation);
  }
};

PlaceVerifier::PlaceVerifier(const StereoCalibration& calibration, const PlaceVerifierOptions& options,
                             std::shared_ptr<pi_runtime::Runtime> runtime)
  : calibration_(calibration)
  , options_(options)
  , pixel_rad_(2.0 / (calibration.left.model.fx + calibration.left.model.fy))
  , matcher_(std::move(runtime))
{
}

PlaceVerifier::~PlaceVerifier() = default;

void PlaceVerifier::gather(const FeatureSet& query, const PlaceView& view, const std::vector<DescriptorMatch>& pairs,
                           std::vector<Match>* matches) const
{
  const Eigen::Vector3d origin = view.T_map_body * view.features->p_body_camera.cast<double>();
  for (const DescriptorMatch& pair : pairs)
  {
    const MapFeature& known = view.features->features[pair.train];
    const MapFeature& seen = query.features[pair.query];
    Match match;
    match.query = pair.query;
    match.distance = pair.distance;
    match.origin = origin;
    match.direction = view.T_map_body.linear() * known.bearing.cast<double>();
    match.inverse_distance = known.inverse_distance;
    match.inverse_deviation = known.inverse_deviation;
    match.estimate = known.inverse_distance;
    match.bearing = T_odom_body_.linear() * seen.bearing.cast<double>();
    match.tangent = estimator::tangentBasis(match.bearing).transpose();
    match.noise = options_.pixel_noise * pixel_rad_ * std::sqrt(1.0 + 0.7 * std::max(known.level, seen.level));
    match.query_inverse_distance = seen.inverse_distance;
    match.query_inverse_deviation = seen.inverse_deviation;
    matches->push_back(match);
  }
}

/// Pose with the most inliers, from pairs of matches.
std::optional<PlaceVerifier::Pose> PlaceVerifier::search(const std::vector<Match>& matches) const
{
  const size_t count = std::min(matches.size(), MOST_MATCHES);
  const auto least = static_cast<size_t>(std::max(6, options_.min_inliers / 3));
  if (count < least)
  {
    return std::nullopt;
  }
  std::vector<Eigen::Vector3d> points(count);
  for (size_t i = 0; i < count; ++i)
  {
    points[i] = matches[i].origin + matches[i].direction / std::max(matches[i].inverse_distance, MIN_INVERSE_DISTANCE);
  }
  Random random;
  Pose best;
  size_t most = least - 1;
  size_t iterations = static_cast<size_t>(options_.max_iterations);
  for (size_t iteration = 0; iteration < iterations; ++iteration)
  {
    // The nearest ones by descriptor first, then more and more (Chum and Matas, CVPR 2005).
    const size_t pool = std::min(count, 12 + iteration);
    const size_t i = random.below(pool);
    const size_t j = random.below(pool);
    const Eigen::Vector3d normal = matches[i].bearing.cross(matches[j].bearing);
    if (i == j || normal.norm() < 0.05)
    {
      continue;
    }
    // Both points, the camera and both rays lie in one plane: normal . Rz(-angle) (X_i - X_j) = 0.
    const Eigen::Vector3d across = points[i] - points[j];
    const double a = normal.x() * across.x() + normal.y() * across.y();
    const double b = normal.x() * across.y() - normal.y() * across.x();
    const double radius = std::hypot(a, b);
    const double cosine = -normal.z() * across.z() / std::max(radius, 1e-12);
    if (std::abs(cosine) > 1.0)
    {
      continue;
    }
    for (const double sign : {1.0, -1.0})
    {
      const double angle = std::atan2(b, a) + sign * std::acos(cosine);
      Pose pose;
      pose.R_map_odom = turnZ(angle);
      Eigen::Matrix<double, 3, 2> rays;
      rays << matches[i].bearing, -matches[j].bearing;
      const Eigen::Vector2d lengths =
          (rays.transpose() * rays).inverse() * (rays.transpose() * (pose.R_map_odom.transpose() * across));
      if (!(lengths.x() > 0.0 && lengths.y() > 0.0))
      {
        continue;
      }
      pose.p_map_camera = points[i] - pose.R_map_odom * (lengths.x() * matches[i].bearing);
      size_t inliers = 0;
      for (size_t k = 0; k < count; ++k)
      {
        inliers += pose.chi2(matches[k], SEARCH_NOISE) < MAX_CHI2 ? 1 : 0;
        if (k == 40 && inliers < 3)
        {
          break;
        }
      }
      if (inliers > most)
      {
        most = inliers;
        best = pose;
        const double good = static_cast<double>(most) / static_cast<double>(count);
        const double needed = std::log(0.005) / std::log(std::max(1e-12, 1.0 - good * good));
        iterations = std::min(iterations, iteration + 1 + static_cast<size_t>(std::max(20.0, needed)));
      }
    }
  }
  return most >= least ? std::make_optional(best) : std::nullopt;
}

/// Gauss-Newton over the inliers. Errors of the pose: shift of the camera in map, then a turn in map.
void PlaceVerifier::refine(std::vector<Match>* matches, Pose* pose, Eigen::Matrix<double, 6, 6>* information) const
{
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  const double gravity = std::sqrt(2.0) * options_.gravity_noise_deg * M_PI / 180.0;
  for (int step = 0; step < STEPS; ++step)
  {
    Matrix6 H = Matrix6::Zero();
    Vector6 g = Vector6::Zero();
    // Where z of odom points in map says how far the attitude has left gravity.
    const Eigen::Vector3d up = pose->R_map_odom.col(2);
    const Eigen::Vector3d tilt = Eigen::Vector3d::UnitZ().cross(up);
    for (int axis = 0; axis < 2; ++axis)
    {
      H(3 + axis, 3 + axis) += 1.0 / (gravity * gravity);
      g(3 + axis) += tilt(axis) / (gravity * gravity);
    }
    for (Match& match : *matches)
    {
      if (!match.inlier)
      {
        continue;
      }
      const Eigen::Vector3d offset = match.origin - pose->p_map_camera;
      Eigen::Matrix<double, 4, 6> J;
      Eigen::Vector4d Jd;
      Eigen::Vector4d r;
      const auto linearize = [&]
      {
        const Eigen::Vector3d P = match.direction + match.estimate * offset;
        const double length = P.norm();
        const Eigen::Vector3d u_map = P / length;
        const Eigen::Matrix3d flat = (Eigen::Matrix3d::Identity() - u_map * u_map.transpose()) / length;
        const Eigen::Matrix<double, 2, 3> to_tangent = match.tangent.transpose() * pose->R_map_odom.transpose();
        const Eigen::Matrix<double, 2, 3> slope = to_tangent * flat / match.noise;
        const double query_weight = 1.0 / match.query_inverse_deviation;
        const double prior_weight = 1.0 / match.inverse_deviation;
        r.head<2>() = to_tangent * u_map / match.noise;
        r(2) = (match.estimate / length - match.query_inverse_distance) * query_weight;
        r(3) = (match.estimate - match.inverse_distance) * prior_weight;
        J.setZero();
        J.block<2, 3>(0, 0) = -match.estimate * slope;
        // u_odom = R^T u_map; R -> exp(theta) R: u_odom changes by R^T (u_map x theta).
        J.block<2, 3>(0, 3) = to_tangent * hat(u_map) / match.noise;
        J.block<1, 3>(2, 0) = match.estimate * match.estimate / (length * length) * u_map.transpose() * query_weight;
        Jd.head<2>() = slope * offset;
        Jd(2) = (1.0 / length - match.estimate / (length * length) * u_map.dot(offset)) * query_weight;
        Jd(3) = prior_weight;
      };
      // The distance that fits this pose, in two steps; the rest is a function of the pose alone.
      for (int inner = 0; inner < 2; ++inner)
      {
        linearize();
        match.estimate -= Jd.dot(r) / Jd.squaredNorm();
        match.estimate = std::max(match.estimate, 0.0);
      }
      linearize();
      const double weight = 1.0 / (1.0 + r.squaredNorm() / 4.0);  // Cauchy
      const Eigen::Matrix<double, 6, 1> cross = J.transpose() * Jd;
      const double inverse = 1.0 / Jd.squaredNorm();
      H += weight * (J.transpose() * J - inverse * cross * cross.transpose());
      g += weight * (J.transpose() * r - inverse * Jd.dot(r) * cross);
    }
    *information = H;
    const Vector6 delta = -(H + 1e-9 * Matrix6::Identity()).ldlt().solve(g);
    if (!delta.allFinite())
    {
      return;
    }
    pose->p_map_camera += delta.head<3>();
    pose->R_map_odom = expSo3(delta.tail<3>()).toRotationMatrix() * pose->R_map_odom;
    if (delta.norm() < 1e-5)
    {
      return;
    }
  }
}

/// Features of a view that lie in the picture.
int PlaceVerifier::expectedIn(const PlaceView& view, const Pose& pose) const
{
  const CameraModel& camera = calibration_.left.model;
  const Eigen::Matrix3d R_camera_map =
      (pose.R_map_odom * T_odom_body_.linear() * calibration_.left.T_body_camera.linear()).transpose();
  const Eigen::Vector3d offset = view.T_map_body * view.features->p_body_camera.cast<double>() - pose.p_map_camera;
  int expected = 0;
  for (const MapFeature& feature : view.features->features)
  {
    const Eigen::Vector3d point = view.T_map_body.linear() * feature.bearing.cast<double>() +
                                  static_cast<double>(feature.inverse_distance) * offset;
    const auto pixel = camera.project(R_camera_map * point);
    expected += pixel && camera.contains(*pixel) ? 1 : 0;
  }
  return expected;
}

/// Matches near the pixels where the pose predicts the features.
void PlaceVerifier::guided(const FeatureSet& query, const std::vector<PlaceView>& views, const Pose& pose,
                           std::vector<Match>* matches) const
{
  std::vector<Eigen::Vector3f> bearings(query.size());
  const Eigen::Matrix3f R_map_body = (pose.R_map_odom * T_odom_body_.linear()).cast<float>();
  for (size_t q = 0; q < query.size(); ++q)
  {
    bearings[q] = R_map_body * query.features[q].bearing;
  }
  const double radius = GUIDED_PX * pixel_rad_;
  struct Best
  {
    int distance = MAX_GUIDED_DISTANCE + 1;
    uint32_t feature = 0;
    size_t view = 0;
  };
  std::vector<Best> best(query.size());
  for (size_t v = 0; v < views.size(); ++v)
  {
    const FeatureSet& known = *views[v].features;
    const Eigen::Vector3d offset = views[v].T_map_body * known.p_body_camera.cast<double>() - pose.p_map_camera;
    for (size_t k = 0; k < known.size(); ++k)
    {
      const MapFeature& feature = known.features[k];
      const Eigen::Vector3d point = views[v].T_map_body.linear() * feature.bearing.cast<double>() +
                                    static_cast<double>(feature.inverse_distance) * offset;
      const double length = point.norm();
      const Eigen::Vector3f u = (point / length).cast<float>();
      // The distance's uncertainty makes the region longer; a circle around it is good enough.
      const double reach = radius + std::min(radius, 2.0 * feature.inverse_deviation * offset.norm() / length);
      const auto least = static_cast<float>(std::cos(reach));
      for (size_t q = 0; q < bearings.size(); ++q)
      {
        if (bearings[q].dot(u) < least)
        {
          continue;
        }
        const int distance = descriptorDistance(query.descriptor(q), known.descriptor(k));
        if (distance < best[q].distance)
        {
          best[q] = {distance, static_cast<uint32_t>(k), v};
        }
      }
    }
  }
  matches->clear();
  for (size_t v = 0; v < views.size(); ++v)
  {
    std::vector<DescriptorMatch> pairs;
    for (size_t q = 0; q < best.size(); ++q)
    {
      if (best[q].distance <= MAX_GUIDED_DISTANCE && best[q].view == v)
      {
        pairs.push_back({static_cast<uint32_t>(q), best[q].feature, best[q].distance});
      }
    }
    gather(query, views[v], pairs, matches);
  }
  for (Match& match : *matches)
  {
    match.inlier = pose.chi2(match, 1.0) < MAX_CHI2;
  }
}

/// Inliers must not lie on one spot or one line.
bool PlaceVerifier::isSpread(const std::vector<Match>& matches) const
{
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double count = 0.0;
  for (const Match& match : matches)
  {
    mean += match.inlier ? match.bearing : Eigen::Vector3d::Zero().eval();
    count += match.inlier ? 1.0 : 0.0;
  }
  if (count < 3.0)
  {
    return false;
  }
  const Eigen::Matrix<double, 3, 2> basis = estimator::tangentBasis(mean.normalized()).transpose();
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  const Eigen::Vector2d centre = basis.transpose() * (mean / count);
  for (const Match& match : matches)
  {
    if (match.inlier)
    {
      const Eigen::Vector2d d = basis.transpose() * match.bearing - centre;
      scatter += d * d.transpose() / count;
    }
  }
  const double small =
      0.5 *
      (scatter.trace() - std::sqrt(std::max(0.0, scatter.trace() * scatter.trace() - 4.0 * scatter.determinant())));
  constexpr double LEAST_RAD = 0.04;  // standard deviation across the narrow side, some 2 degrees
  return small > LEAST_RAD * LEAST_RAD;
}

std::optional<PlaceMatch> PlaceVerifier::verify(const FeatureSet& query, const Eigen::Isometry3d& T_odom_body,
                                                const std::vector<PlaceView>& views, bool expected)
{
  if (views.empty() || query.size() < static_cast<size_t>(options_.min_inliers))
  {
    return std::nullopt;
  }
  T_odom_body_ = T_odom_body;
  std::vector<Match> matches;
  gather(query, views.front(), matcher_.match(query, *views.front().features, MAX_DISTANCE), &matches);
  const std::optional<Pose> first = search(matches);
  if (!first)
  {
    return std::nullopt;
  }
  Pose pose = *first;
  for (Match& match : matches)
  {
    match.inlier = pose.chi2(match, SEARCH_NOISE) < MAX_CHI2;
  }
  Eigen::Matrix<double, 6, 6> information;
  refine(&matches, &pose, &information);
  // Among all features of both pictures, few matches agree with any pose by chance.
  const auto mutual = std::count_if(matches.begin(), matches.end(),
                                    [&](const Match& match) { return pose.chi2(match, 1.0) < MAX_CHI2; });
  for (int round = 0; round < ROUNDS; ++round)
  {
    guided(query, views, pose, &matches);
    refine(&matches, &pose, &information);
  }
  int inliers = 0;
  for (Match& match : matches)
  {
    match.inlier = pose.chi2(match, 1.0) < MAX_CHI2;
    inliers += match.inlier ? 1 : 0;
  }
  PlaceMatch result;
  result.inliers = inliers;
  result.support = static_cast<double>(inliers) / std::max(1, expectedIn(views.front(), pose));
  const double least =
      expected || mutual >= options_.min_inliers ? options_.min_support_confirmed : options_.min_support;
  if (inliers < options_.min_inliers || result.support < least || !isSpread(matches))
  {
    return std::nullopt;
  }
  const Eigen::Matrix<double, 6, 6> covariance = information.inverse();
  const double tilt = std::acos(std::clamp(pose.R_map_odom(2, 2), -1.0, 1.0));
  if (!covariance.allFinite() || tilt > 6.0 * options_.gravity_noise_deg * M_PI / 180.0)
  {
    return std::nullopt;
  }
  const double heading =
      std::atan2(pose.R_map_odom(1, 0) - pose.R_map_odom(0, 1), pose.R_map_odom(0, 0) + pose.R_map_odom(1, 1));
  constexpr int ROWS[4] = {0, 1, 2, 5};
  for (int i = 0; i < 4; ++i)
  {
    for (int j = 0; j < 4; ++j)
    {
      result.covariance(i, j) = covariance(ROWS[i], ROWS[j]);
    }
    result.covariance(i, i) += i < 3 ? POSITION_FLOOR_M * POSITION_FLOOR_M : HEADING_FLOOR_RAD * HEADING_FLOOR_RAD;
  }
  // The remaining tilt is noise of gravity: the position of the camera is the measurement, not the tilt.
  const Eigen::Matrix3d R_map_odom = turnZ(heading);
  const Eigen::Vector3d p_odom_camera = T_odom_body * query.p_body_camera.cast<double>();
  result.T_map_odom.linear() = R_map_odom;
  result.T_map_odom.translation() = pose.p_map_camera - R_map_odom * p_odom_camera;
  result.T_map_body = result.T_map_odom * T_odom_body;
  return result;
}

}  // namespace pi_slam::map
