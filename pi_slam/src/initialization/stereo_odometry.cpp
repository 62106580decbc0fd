#include "initialization/stereo_odometry.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace pi_slam
{

namespace
{

constexpr double EPIPOLAR_PX = 3.0;  ///< farthest of two rays from each other
constexpr double HUBER_PX = 1.5;
constexpr double INLIER_PX = 3.0;  ///< also standard deviations where depths are uncertain: noise counts as a pixel
constexpr size_t MIN_INLIERS = 8;
constexpr double MAX_MEAN_ERROR_PX = 2.5;  ///< of a landmark's observations
constexpr int RESECTION_ITERATIONS = 20;
constexpr int ADJUSTMENT_ITERATIONS = 10;

double huberWeight(double error)
{
  return error <= HUBER_PX ? 1.0 : HUBER_PX / error;
}

double huberCost(double error)
{
  return error <= HUBER_PX ? 0.5 * error * error : HUBER_PX * (error - 0.5 * HUBER_PX);
}

/// @param values  not empty.
double median(std::vector<double> values)
{
  const auto middle = values.begin() + static_cast<long>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Median per axis over the half with the smaller keys.
Eigen::Vector3d medianOfNearer(std::vector<std::pair<double, Eigen::Vector3d>>* places)
{
  const auto middle = places->begin() + static_cast<long>((places->size() + 1) / 2);
  std::nth_element(places->begin(), middle, places->end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  Eigen::Vector3d result;
  for (int axis = 0; axis < 3; ++axis)
  {
    std::vector<double> values;
    for (auto place = places->begin(); place != middle; ++place)
    {
      values.push_back(place->second[axis]);
    }
    result[axis] = median(std::move(values));
  }
  return result;
}

}  // namespace

StereoOdometry::StereoOdometry(const StereoCalibration& calibration)
{
  for (const int i : {LEFT, RIGHT})
  {
    const MountedCamera& camera = i == LEFT ? calibration.left : calibration.right;
    cameras_[i].R_camera_body = camera.T_body_camera.linear().transpose();
    cameras_[i].p_body = camera.T_body_camera.translation();
    cameras_[i].focal = 0.5 * (camera.model.fx + camera.model.fy);
  }
  far_m_ = (cameras_[LEFT].p_body - cameras_[RIGHT].p_body).norm() * cameras_[LEFT].focal / 0.5;
}

bool StereoOdometry::triangulate(const FeatureObservation& feature, Eigen::Vector3d* p_body) const
{
  if (!feature.seen[LEFT] || !feature.seen[RIGHT])
  {
    return false;
  }
  // The points on both rays that are nearest to each other.
  const Eigen::Vector3d a = cameras_[LEFT].R_camera_body.transpose() * feature.bearing[LEFT];
  const Eigen::Vector3d b = cameras_[RIGHT].R_camera_body.transpose() * feature.bearing[RIGHT];
  const Eigen::Vector3d base = cameras_[RIGHT].p_body - cameras_[LEFT].p_body;
  const double cosine = a.dot(b);
  const double sine_square = a.cross(b).squaredNorm();
  double depth = far_m_;
  if (sine_square > 1e-12)
  {
    depth = (a.dot(base) - cosine * b.dot(base)) / sine_square;
  }
  if (depth <= 0.0)
  {
    // Rays that diverge: a far point with noise, or no point at all.
    depth = far_m_;
  }
  depth = std::min(depth, far_m_);
  const Eigen::Vector3d on_left = cameras_[LEFT].p_body + depth * a;
  const Eigen::Vector3d seen_right = (on_left - cameras_[RIGHT].p_body).normalized();
  // Half the misfit is left if both cameras share it.
  if (!((seen_right - b).norm() * cameras_[RIGHT].focal < EPIPOLAR_PX))
  {
    return false;
  }
  const Eigen::Vector3d on_right = cameras_[RIGHT].p_body + (on_left - cameras_[RIGHT].p_body).dot(b) * b;
  *p_body = 0.5 * (on_left + on_right);
  return true;
}

StereoOdometry::Triangulated StereoOdometry::countStereo(const FrameFeatures& frame) const
{
  Triangulated count;
  Eigen::Vector3d ignored;
  for (const FeatureObservation& feature : frame.features)
  {
    count.matched += feature.seen[LEFT] && feature.seen[RIGHT];
    count.valid += triangulate(feature, &ignored);
  }
  return count;
}

StereoOdometry::Observation StereoOdometry::observe(const FeatureObservation& feature, size_t frame, int camera) const
{
  Observation observation{frame, camera, feature.bearing[camera], {}};
  const Eigen::Vector3d u = observation.bearing.unitOrthogonal();
  observation.tangent.row(0) = cameras_[camera].focal * u.transpose();
  observation.tangent.row(1) = cameras_[camera].focal * observation.bearing.cross(u).transpose();
  return observation;
}

StereoOdometry::Residual StereoOdometry::residual(const Pose& pose, const Observation& observation,
                                                  const Eigen::Vector3d& p_ref) const
{
  Residual residual;
  const Camera& camera = cameras_[observation.camera];
  residual.p_body = pose.q.conjugate() * (p_ref - pose.p);
  const Eigen::Vector3d p_camera = camera.R_camera_body * (residual.p_body - camera.p_body);
  const double range = p_camera.norm();
  const Eigen::Vector3d direction = p_camera / range;
  residual.valid = range > 1e-3 && direction.dot(observation.bearing) > 0.5;
  residual.error = observation.tangent * direction;
  residual.by_body = observation.tangent * (Eigen::Matrix3d::Identity() - direction * direction.transpose()) *
                     camera.R_camera_body / range;
  return residual;
}

StereoOdometry::Weighted StereoOdometry::weigh(const Pose& pose, const Observation& observation,
                                               const Landmark& landmark) const
{
  Weighted weighted;
  weighted.residual = residual(pose, observation, landmark.p_ref);
  if (weighted.residual.valid)
  {
    weighted.by_depth = weighted.residual.by_body * (pose.q.conjugate() * landmark.ray_ref);
    const Eigen::Matrix2d covariance =
        Eigen::Matrix2d::Identity() + landmark.variance * weighted.by_depth * weighted.by_depth.transpose();
    weighted.information = covariance.inverse();
    weighted.error = std::sqrt(weighted.residual.error.dot(weighted.information * weighted.residual.error));
  }
  return weighted;
}

void StereoOdometry::record(const FrameFeatures& frame)
{
  const size_t index = poses_.size() - 1;
  for (const FeatureObservation& feature : frame.features)
  {
    auto found = landmarks_.find(feature.id);
    if (found == landmarks_.end())
    {
      Eigen::Vector3d p_body;
      if (!triangulate(feature, &p_body))
      {
        continue;
      }
      // A pixel of disparity.
      const double range = (p_body - cameras_[LEFT].p_body).norm();
      const double deviation = 2.0 * range * range / far_m_;
      Landmark landmark{poses_[index].q * p_body + poses_[index].p,
                        poses_[index].q * (p_body - cameras_[LEFT].p_body) / range,
                        deviation * deviation,
                        {}};
      found = landmarks_.emplace(feature.id, std::move(landmark)).first;
    }
    Landmark& landmark = found->second;
    const bool first = landmark.observations.empty();
    for (const int camera : {LEFT, RIGHT})
    {
      if (!feature.seen[camera])
      {
        continue;
      }
      landmark.observations.push_back(observe(feature, index, camera));
      // A Kalman filter of the depth alone; poses count as known.
      const Weighted weighted = first ? Weighted() : weigh(poses_[index], landmark.observations.back(), landmark);
      if (weighted.error < INLIER_PX)
      {
        const Eigen::Vector2d gain = landmark.variance * weighted.information * weighted.by_depth;
        landmark.p_ref -= gain.dot(weighted.residual.error) * landmark.ray_ref;
        landmark.variance *= 1.0 - gain.dot(weighted.by_depth);
      }
    }
  }
}

void StereoOdometry::start(const FrameFeatures& frame)
{
  landmarks_.clear();
  poses_.assign(1, Pose());
  record(frame);
}

double StereoOdometry::append(const FrameFeatures& frame, const Eigen::Quaterniond& R_last_now)
{
  Pose pose = poses_.back();
  pose.q = (pose.q * R_last_now).normalized();
  std::vector<std::pair<Observation, const Landmark*>> known;
  std::vector<std::pair<double, Eigen::Vector3d>> places;  // depth; where the body is, as a point seen by stereo says
  for (const FeatureObservation& feature : frame.features)
  {
    const auto found = landmarks_.find(feature.id);
    Eigen::Vector3d p_body;
    if (found != landmarks_.end() && triangulate(feature, &p_body))
    {
      places.emplace_back(p_body.norm(), found->second.p_ref - pose.q * p_body);
    }
    for (const int camera : {LEFT, RIGHT})
    {
      if (found != landmarks_.end() && feature.seen[camera])
      {
        known.emplace_back(observe(feature, poses_.size(), camera), &found->second);
      }
    }
  }
  // Gauss-Newton with Cauchy weights, whose scale follows the median error down.
  std::vector<Weighted> residuals(known.size());
  std::vector<double> errors;
  const auto evaluate = [&]
  {
    errors.clear();
    for (size_t i = 0; i < known.size(); ++i)
    {
      residuals[i] = weigh(pose, known[i].first, *known[i].second);
      errors.push_back(residuals[i].error);
    }
  };
  // It begins with the speed from before, or with the median of the nearer points, whichever agrees better.
  if (poses_.size() > 1)
  {
    pose.p += pose.p - poses_[poses_.size() - 2].p;
  }
  evaluate();
  if (places.size() >= MIN_INLIERS)
  {
    const Eigen::Vector3d p_before = pose.p;
    const double before = median(errors);
    pose.p = medianOfNearer(&places);
    evaluate();
    if (median(errors) > before)
    {
      pose.p = p_before;
      evaluate();
    }
  }
  for (int iteration = 0; iteration < RESECTION_ITERATIONS && known.size() >= 2 * MIN_INLIERS; ++iteration)
  {
    const double scale = std::max(1.0, 1.5 * median(errors));
    Eigen::Matrix<double, 6, 6> H = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
    const Eigen::Matrix3d Rt = pose.q.conjugate().toRotationMatrix();
    for (size_t i = 0; i < known.size(); ++i)
    {
      const Residual& r = residuals[i].residual;
      if (!r.valid)
      {
        continue;
      }
      const Eigen::Matrix2d weight = residuals[i].information / (1.0 + errors[i] * errors[i] / (scale * scale));
      Eigen::Matrix<double, 2, 6> J;
      J << -r.by_body * Rt, r.by_body * hat(r.p_body);
      H.noalias() += J.transpose() * weight * J;
      b.noalias() -= J.transpose() * (weight * r.error);
    }
    H.diagonal() += 1e-9 * H.diagonal().maxCoeff() * Eigen::Matrix<double, 6, 1>::Ones();
    const Eigen::Matrix<double, 6, 1> delta = H.ldlt().solve(b);
    if (!delta.allFinite())
    {
      break;
    }
    pose.p += delta.head<3>();
    pose.q = (pose.q * expSo3(delta.tail<3>())).normalized();
    evaluate();
    if (delta.norm() < 1e-6)
    {
      break;
    }
  }
  const auto inliers =
      static_cast<size_t>(std::count_if(errors.begin(), errors.end(), [](double error) { return error < INLIER_PX; }));
  poses_.push_back(pose);
  record(frame);
  return inliers < MIN_INLIERS ? -1.0 : static_cast<double>(inliers) / static_cast<double>(errors.size());
}

double StereoOdometry::cost(const std::vector<Pose>& poses, const std::vector<Eigen::Vector3d>& points) const
{
  double sum = 0.0;
  size_t i = 0;
  for (const auto& entry : landmarks_)
  {
    for (const Observation& observation : entry.second.observations)
    {
      const Residual r = residual(poses[observation.frame], observation, points[i]);
      // A point behind the camera costs the maximum.
      sum += huberCost(r.valid ? r.error.norm() : 1000.0);
    }
    ++i;
  }
  return sum;
}

bool StereoOdometry::step(double damping, std::vector<Pose>* poses, std::vector<Eigen::Vector3d>* points) const
{
  const long unknowns = 6 * (static_cast<long>(poses->size()) - 1);
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(unknowns, unknowns);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(unknowns);
  struct Eliminated
  {
    Eigen::Matrix3d inverse;
    Eigen::Vector3d gradient;
    std::vector<std::pair<long, Eigen::Matrix<double, 6, 3>>> blocks;  ///< first row of each pose, H_pose_point
  };
  std::vector<Eliminated> eliminated(landmarks_.size());
  size_t index = 0;
  for (const auto& entry : landmarks_)
  {
    Eliminated& point = eliminated[index];
    Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (const Observation& observation : entry.second.observations)
    {
      const Pose& pose = (*poses)[observation.frame];
      const Residual r = residual(pose, observation, (*points)[index]);
      if (!r.valid)
      {
        continue;
      }
      const double weight = huberWeight(r.error.norm());
      const Eigen::Matrix<double, 2, 3> Jp = r.by_body * pose.q.conjugate().toRotationMatrix();
      V.noalias() += weight * Jp.transpose() * Jp;
      gradient.noalias() -= weight * Jp.transpose() * r.error;
      if (observation.frame == 0)
      {
        continue;
      }
      const long row = 6 * (static_cast<long>(observation.frame) - 1);
      Eigen::Matrix<double, 2, 6> J;
      J << -Jp, r.by_body * hat(r.p_body);
      H.block<6, 6>(row, row).noalias() += weight * J.transpose() * J;
      b.segment<6>(row).noalias() -= weight * J.transpose() * r.error;
      // Both cameras of a pair follow each other.
      if (point.blocks.empty() || point.blocks.back().first != row)
      {
        point.blocks.emplace_back(row, Eigen::Matrix<double, 6, 3>::Zero());
      }
      point.blocks.back().second.noalias() += weight * J.transpose() * Jp;
    }
    V.diagonal() *= 1.0 + damping;
    V.diagonal().array() += 1e-9 * V.trace() + 1e-12;
    point.inverse = V.inverse();
    point.gradient = gradient;
    ++index;
  }
  H.diagonal() *= 1.0 + damping;
  for (const Eliminated& point : eliminated)
  {
    for (const auto& [row, W] : point.blocks)
    {
      const Eigen::Matrix<double, 6, 3> WV = W * point.inverse;
      b.segment<6>(row).noalias() -= WV * point.gradient;
      for (const auto& [column, other] : point.blocks)
      {
        H.block<6, 6>(row, column).noalias() -= WV * other.transpose();
      }
    }
  }
  H.diagonal().array() += 1e-9;
  const Eigen::VectorXd delta = H.ldlt().solve(b);
  if (!delta.allFinite())
  {
    return false;
  }
  for (size_t i = 1; i < poses->size(); ++i)
  {
    const long row = 6 * (static_cast<long>(i) - 1);
    (*poses)[i].p += delta.segment<3>(row);
    (*poses)[i].q = ((*poses)[i].q * expSo3(delta.segment<3>(row + 3))).normalized();
  }
  for (size_t i = 0; i < eliminated.size(); ++i)
  {
    Eigen::Vector3d gradient = eliminated[i].gradient;
    for (const auto& [row, W] : eliminated[i].blocks)
    {
      gradient.noalias() -= W.transpose() * delta.segment<6>(row);
    }
    (*points)[i] += eliminated[i].inverse * gradient;
  }
  return true;
}

void StereoOdometry::minimize()
{
  std::vector<Eigen::Vector3d> points;
  for (const auto& entry : landmarks_)
  {
    points.push_back(entry.second.p_ref);
  }
  double damping = 1e-4;
  double now = cost(poses_, points);
  for (int iteration = 0; iteration < ADJUSTMENT_ITERATIONS && poses_.size() > 1; ++iteration)
  {
    std::vector<Pose> next_poses = poses_;
    std::vector<Eigen::Vector3d> next_points = points;
    const double next = step(damping, &next_poses, &next_points) ? cost(next_poses, next_points) : now;
    if (!(next < now))
    {
      damping *= 10.0;
      continue;
    }
    const bool converged = now - next < 1e-3 * now;
    poses_ = std::move(next_poses);
    points = std::move(next_points);
    damping = std::max(1e-8, 0.1 * damping);
    now = next;
    if (converged)
    {
      break;
    }
  }
  size_t i = 0;
  for (auto& entry : landmarks_)
  {
    entry.second.p_ref = points[i++];
  }
}

double StereoOdometry::adjust()
{
  minimize();
  // An observation that still does not fit moves, or is a wrong match.
  size_t good = 0;
  size_t count = 0;
  for (auto entry = landmarks_.begin(); entry != landmarks_.end();)
  {
    const std::vector<Observation>& observations = entry->second.observations;
    double sum = 0.0;
    for (const Observation& observation : observations)
    {
      const Residual r = residual(poses_[observation.frame], observation, entry->second.p_ref);
      sum += r.valid ? r.error.norm() : 1e6;
    }
    const bool fits = sum < MAX_MEAN_ERROR_PX * static_cast<double>(observations.size());
    good += fits ? observations.size() : 0;
    count += observations.size();
    entry = fits ? std::next(entry) : landmarks_.erase(entry);
  }
  if (good < count)
  {
    minimize();
  }
  return count == 0 ? 0.0 : static_cast<double>(good) / static_cast<double>(count);
}

}  // namespace pi_slam
