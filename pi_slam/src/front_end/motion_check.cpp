#include "front_end/motion_check.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "estimator/factors.h"

namespace pi_slam::front_end
{

namespace
{

constexpr size_t LEAST_POINTS = 12;  ///< with depth, for a motion of six unknowns
constexpr size_t LEAST_RAYS = 15;    ///< for a direction of translation
constexpr double MOST_REJECTED =
    0.5;  ///< part of the features; if it were more, the motion would be the doubtful thing
constexpr double LEAST_AGAINST = 6.0;        ///< features that contradict the motion that was found
constexpr double LEAST_PART_AGAINST = 0.08;  ///< likewise, part of all; false matches are fewer
constexpr double DISPARITY_SIGMA_PX = 0.5;
constexpr double TRANSLATION_SIGMA_M = 1.0;  ///< holds the translation where all points are far away
constexpr double LEAST_PARALLAX_PX = 3.0;    ///< below it, a direction of translation says nothing
constexpr int MOST_HYPOTHESES = 60;
constexpr int MOST_STEPS = 12;

}  // namespace

MotionCheck::MotionCheck(const StereoGeometry& geometry, double tolerance_px)
  : geometry_(geometry), tolerance_px_(tolerance_px)
{
}

Eigen::Vector2d MotionCheck::residual(const MovedFeature& feature, const Point& point, const BodyMotion& motion,
                                      Eigen::Matrix<double, 2, 6>* jacobian) const
{
  // The point over its distance: all terms stay finite at infinity.
  const Eigen::Isometry3d& T_body_camera = geometry_.T_body_camera(feature.camera);
  const double rho = feature.inverse_distance;
  const Eigen::Vector3d turned = motion.R_now_last * point.x_last;
  const Eigen::Vector3d y_body = turned + rho * (motion.p_now_last - T_body_camera.translation());
  const Eigen::Vector3d y = T_body_camera.linear().transpose() * y_body;
  const double length = y.norm();
  const Eigen::Vector2d e = point.axes * y / length;

  // The depth is uncertain: a step along the epipolar line costs less (Schur complement of 2 x 2).
  const Eigen::Vector3d y_rho = T_body_camera.linear().transpose() * (motion.R_now_last * T_body_camera.translation() +
                                                                      motion.p_now_last - T_body_camera.translation());
  const Eigen::Vector2d slope =
      point.axes * y_rho / length * (DISPARITY_SIGMA_PX / geometry_.disparityScale()) * (3.0 / tolerance_px_);
  const double squared = slope.squaredNorm();
  // (I + s s^T)^(-1/2) = I - s s^T (1 - 1 / sqrt(1 + |s|^2)) / |s|^2
  Eigen::Matrix2d whiten = Eigen::Matrix2d::Identity();
  if (squared > 1e-12)
  {
    whiten -= slope * slope.transpose() * ((1.0 - 1.0 / std::sqrt(1.0 + squared)) / squared);
  }
  whiten /= tolerance_px_;
  if (jacobian != nullptr)
  {
    const Eigen::Matrix<double, 2, 3> by_body = whiten * point.axes * T_body_camera.linear().transpose() / length;
    jacobian->leftCols<3>() = -by_body * hat(turned);
    jacobian->rightCols<3>() = by_body * rho;
  }
  return y.dot(feature.bearing_now) > 0.0 ? Eigen::Vector2d(whiten * e) : Eigen::Vector2d::Constant(1e3);
}

bool MotionCheck::estimate(const std::vector<MovedFeature>& features, double rotation_sigma_rad, BodyMotion* motion)
{
  points_.clear();
  for (size_t i = 0; i < features.size(); ++i)
  {
    const MovedFeature& f = features[i];
    if (f.has_depth)
    {
      const Eigen::Isometry3d& T_body_camera = geometry_.T_body_camera(f.camera);
      points_.push_back({i, estimator::tangentBasis(f.bearing_now) * geometry_.focal(f.camera),
                         T_body_camera.linear() * f.bearing_last + f.inverse_distance * T_body_camera.translation()});
    }
  }
  if (points_.size() < LEAST_POINTS)
  {
    return false;
  }
  const Eigen::Matrix3d R_prior = motion->R_now_last;
  std::vector<double> errors;
  for (const Point& point : points_)
  {
    errors.push_back(residual(features[point.feature], point, *motion, nullptr).norm());
  }
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  // Weights fall to a quarter at `scale` (in units of the tolerance).
  double scale = std::min(std::max(2.0 * errors[errors.size() / 2], 1.0), 1e3);
  for (int step = 0; step < MOST_STEPS; ++step)
  {
    Eigen::Matrix<double, 6, 6> H = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
    const Eigen::AngleAxisd from_prior(motion->R_now_last * R_prior.transpose());
    const double rotation_weight = 1.0 / (rotation_sigma_rad * rotation_sigma_rad);
    const double translation_weight = 1.0 / (TRANSLATION_SIGMA_M * TRANSLATION_SIGMA_M);
    H.diagonal() << Eigen::Vector3d::Constant(rotation_weight), Eigen::Vector3d::Constant(translation_weight);
    b.head<3>() = rotation_weight * from_prior.angle() * from_prior.axis();
    b.tail<3>() = translation_weight * motion->p_now_last;
    for (const Point& point : points_)
    {
      Eigen::Matrix<double, 2, 6> J;
      const Eigen::Vector2d e = residual(features[point.feature], point, *motion, &J);
      const double part = 1.0 / (1.0 + e.squaredNorm() / (scale * scale));
      const double weight = 9.0 * part * part;  // the tolerance is three standard deviations
      H.noalias() += weight * J.transpose() * J;
      b.noalias() += weight * J.transpose() * e;
    }
    const Eigen::Matrix<double, 6, 1> delta = -H.ldlt().solve(b);
    if (!delta.allFinite())
    {
      return false;
    }
    motion->R_now_last = expSo3(delta.head<3>()).toRotationMatrix() * motion->R_now_last;
    motion->p_now_last += delta.tail<3>();
    const bool strict = scale <= 0.5;
    if (strict && delta.head<3>().norm() < 1e-5 && delta.tail<3>().norm() < 1e-4)
    {
      break;
    }
    scale = std::max(0.5, scale * 0.5);
  }
  return true;
}

void MotionCheck::judgeByMotion(const std::vector<MovedFeature>& features, const BodyMotion& motion,
                                std::vector<uint8_t>* consistent) const
{
  size_t next_point = 0;
  for (size_t i = 0; i < features.size(); ++i)
  {
    const MovedFeature& f = features[i];
    if (f.has_depth)
    {
      (*consistent)[i] = residual(f, points_[next_point++], motion, nullptr).squaredNorm() <= 1.0 ? 1 : 0;
      continue;
    }
    // Somewhere on the line from infinity to the camera.
    const Eigen::Isometry3d& T_body_camera = geometry_.T_body_camera(f.camera);
    const Eigen::Matrix3d R_camera_body = T_body_camera.linear().transpose();
    const Eigen::Vector3d far = R_camera_body * motion.R_now_last * T_body_camera.linear() * f.bearing_last;
    const Eigen::Vector3d towards = R_camera_body * (motion.R_now_last * T_body_camera.translation() +
                                                     motion.p_now_last - T_body_camera.translation());
    const Eigen::Matrix<double, 2, 3> axes = estimator::tangentBasis(far) * geometry_.focal(f.camera);
    const Eigen::Vector2d moved = axes * f.bearing_now;
    const Eigen::Vector2d direction = axes * towards;
    const double length = direction.norm();
    const double along = length > 1e-9 ? std::max(0.0, moved.dot(direction) / length) : 0.0;
    const double across = std::sqrt(std::max(0.0, moved.squaredNorm() - along * along));
    (*consistent)[i] = across <= tolerance_px_ ? 1 : 0;
  }
}

void MotionCheck::judgeByTranslation(const std::vector<MovedFeature>& features, const BodyMotion& motion,
                                     std::vector<uint8_t>* consistent) const
{
  // Pure translation after the rotation is taken out: far x now is across the translation.
  std::vector<Eigen::Vector3d> far(features.size());
  std::vector<Eigen::Vector3d> now(features.size());
  std::vector<size_t> moving;
  for (size_t i = 0; i < features.size(); ++i)
  {
    const MovedFeature& f = features[i];
    const Eigen::Matrix3d R_body_camera = geometry_.T_body_camera(f.camera).linear();
    far[i] = motion.R_now_last * R_body_camera * f.bearing_last;
    now[i] = R_body_camera * f.bearing_now;
    if (far[i].cross(now[i]).norm() * geometry_.focal(f.camera) > LEAST_PARALLAX_PX)
    {
      moving.push_back(i);
    }
  }
  if (moving.size() < LEAST_RAYS)
  {
    return;
  }
  const auto error = [&](size_t i, const Eigen::Vector3d& translation)
  {
    const Eigen::Vector3d normal = translation.cross(far[i]);
    const double length = normal.norm();
    return length > 1e-6 ? geometry_.focal(features[i].camera) * std::abs(normal.dot(now[i])) / length : 0.0;
  };
  const double tolerance = 2.0 * tolerance_px_;  // the rotation is not refined here
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  size_t most = 0;
  uint32_t seed = 12345;
  const auto pick = [&seed, &moving]
  {
    seed = seed * 1664525U + 1013904223U;
    return moving[(seed >> 8) % moving.size()];
  };
  for (int k = 0; k < MOST_HYPOTHESES; ++k)
  {
    const size_t a = pick();
    const size_t b = pick();
    const Eigen::Vector3d translation = far[a].cross(now[a]).cross(far[b].cross(now[b]));
    if (a == b || translation.norm() < 1e-9)
    {
      continue;
    }
    size_t count = 0;
    for (size_t i = 0; i < features.size(); ++i)
    {
      count += error(i, translation.normalized()) <= tolerance ? 1 : 0;
    }
    if (count > most)
    {
      most = count;
      best = translation.normalized();
    }
  }
  for (size_t i = 0; i < features.size() && most > 0; ++i)
  {
    (*consistent)[i] = error(i, best) <= tolerance ? 1 : 0;
  }
}

bool MotionCheck::check(const std::vector<MovedFeature>& features, double rotation_sigma_rad, BodyMotion* motion,
                        std::vector<uint8_t>* consistent, const BodyMotion* expected)
{
  others_move_ = false;
  const bool known = findMotion(features, rotation_sigma_rad, motion, consistent);
  if (expected == nullptr || points_.size() < LEAST_POINTS)
  {
    return known;
  }
  std::vector<uint8_t> as_expected(features.size());
  judgeByMotion(features, *expected, &as_expected);
  size_t agreeing = 0;
  size_t against = 0;  // agree with one and not with the other: far points agree with both
  for (size_t i = 0; i < features.size(); ++i)
  {
    agreeing += as_expected[i];
    against += as_expected[i] != 0 && (!known || (*consistent)[i] == 0) ? 1 : 0;
  }
  const auto part = [&features](double of) { return of * static_cast<double>(features.size()); };
  others_move_ = known ? static_cast<double>(against) >= std::max(LEAST_AGAINST, part(LEAST_PART_AGAINST))
                       : agreeing >= LEAST_POINTS && static_cast<double>(agreeing) < part(1.0 - MOST_REJECTED);
  if (!others_move_)
  {
    return known;
  }
  *consistent = as_expected;
  *motion = *expected;
  return true;
}

bool MotionCheck::findMotion(const std::vector<MovedFeature>& features, double rotation_sigma_rad, BodyMotion* motion,
                             std::vector<uint8_t>* consistent)
{
  consistent->assign(features.size(), 1);
  const BodyMotion prior{motion->R_now_last, Eigen::Vector3d::Zero()};
  *motion = prior;
  const bool known = estimate(features, rotation_sigma_rad, motion);
  if (known)
  {
    judgeByMotion(features, *motion, consistent);
  }
  else
  {
    *motion = prior;
    judgeByTranslation(features, *motion, consistent);
  }
  const auto kept = static_cast<double>(std::count(consistent->begin(), consistent->end(), 1));
  if (kept < (1.0 - MOST_REJECTED) * static_cast<double>(features.size()))
  {
    consistent->assign(features.size(), 1);
    *motion = prior;
    return false;
  }
  return known;
}

}  // namespace pi_slam::front_end
