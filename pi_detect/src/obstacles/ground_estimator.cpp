#include "obstacles/ground_estimator.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace pi_detect::obstacles
{

namespace
{

constexpr int SAMPLE_STEP_PX = 7;  // odd: does not fall into step with patterns
constexpr int HYPOTHESES = 60;
constexpr double MIN_TRIANGLE = 0.02;  // of three samples, part of the picture: of a smaller one noise makes the plane
constexpr size_t SCORED_SAMPLES = 400;
constexpr size_t MIN_INLIERS = 80;
constexpr double MIN_SPREAD = 1.5;  // of their disparities, in tolerances: the strip of a wall at the ground's height
                                    // fits any plane, but has one disparity
constexpr double INLIER_PX = 0.6;
constexpr double INLIER_PART = 0.02;  // of the disparity: roads are not quite planes
constexpr int REFINEMENTS = 4;
constexpr double SAMPLES_PER_INFORMATION = 20.0;  // blocks of matching overlap: errors of neighbours are alike
// What changes from pair to pair, standard deviations.
constexpr double VEHICLE_TILT = 0.012;      // vehicle and road, where the vehicle's motion is unknown [rad]
constexpr double ROAD_TILT = 0.005;         // road alone: 0.5 m of a curve with a radius of 100 m, as over a hump [rad]
constexpr double PRIOR_HEIGHT_PART = 0.03;  // of the camera's height
constexpr double MOUNTING_TILT = 0.02;      // of the mounting: a degree, as measured by hand [rad]

double tolerance(double disparity)
{
  return INLIER_PX + INLIER_PART * std::max(0.0, disparity);
}

Eigen::Vector3d coefficients(const DisparityPlane& plane)
{
  return {plane.a, plane.b, plane.c};
}

}  // namespace

GroundEstimator::GroundEstimator(const MatchedCamera& camera, const Eigen::Isometry3d& T_base_left,
                                 const StereoObstacleOptions& options)
  : camera_(camera), T_base_left_(T_base_left), options_(options), tilt_sigma_(MOUNTING_TILT)
{
}

// Plane in the optical frame: n . p = -H, n up, H the camera's height. With p = fb / d * ray(u, v):
// d = -fb / H * n . ray(u, v), linear in u and v.
DisparityPlane GroundEstimator::toDisparity(const GroundPlane& plane) const
{
  const Eigen::Vector3d n = T_base_left_.linear().transpose() * plane.normal;
  DisparityPlane result;
  result.camera_height_m = std::max(0.05, plane.normal.dot(T_base_left_.translation()) - plane.offset_m);
  const double scale = -camera_.fb / result.camera_height_m;
  result.a = scale * n.x() / camera_.fx;
  result.b = scale * n.y() / camera_.fy;
  result.c = scale * (n.z() - n.x() * camera_.cx / camera_.fx - n.y() * camera_.cy / camera_.fy);
  return result;
}

bool GroundEstimator::toBase(const Eigen::Vector3d& abc, GroundPlane* plane) const
{
  Eigen::Vector3d n(abc.x() * camera_.fx, abc.y() * camera_.fy, abc.z() + abc.x() * camera_.cx + abc.y() * camera_.cy);
  const double length = n.norm();
  if (!(length > 1e-9))
  {
    return false;
  }
  const double camera_height_m = camera_.fb / length;
  plane->normal = T_base_left_.linear() * (-n / length);
  plane->offset_m = plane->normal.dot(T_base_left_.translation()) - camera_height_m;
  return isWithinMounting(*plane);
}

bool GroundEstimator::isWithinMounting(const GroundPlane& plane) const
{
  return plane.normal.z() >= std::cos(options_.max_ground_tilt) &&
         std::abs(plane.offset_m) <= options_.max_ground_step_m;
}

DisparityPlane GroundEstimator::disparityPlane() const
{
  DisparityPlane plane = toDisparity(plane_);
  plane.sigma_px = camera_.fb / plane.camera_height_m * tilt_sigma_;
  return plane;
}

void GroundEstimator::carry(const std::optional<Eigen::Isometry3d>& T_odom_base)
{
  double change = VEHICLE_TILT;
  if (T_odom_base && T_odom_last_ && pairs_without_ < FORGET_AFTER_PAIRS)
  {
    const Eigen::Isometry3d T_now_last = T_odom_base->inverse() * *T_odom_last_;
    GroundPlane moved;
    moved.normal = T_now_last.linear() * plane_.normal;
    moved.offset_m = plane_.offset_m + moved.normal.dot(T_now_last.translation());
    // Beyond the mounting's tolerance: odometry that jumps.
    if (isWithinMounting(moved))
    {
      plane_ = moved;
      change = ROAD_TILT;
    }
  }
  T_odom_last_ = T_odom_base;
  tilt_sigma_ = std::min(MOUNTING_TILT, std::hypot(tilt_sigma_, change));
}

void GroundEstimator::collect(const cv::Mat& disparity)
{
  samples_.clear();
  const Eigen::Matrix3d R = T_base_left_.linear();
  const Eigen::Vector3d t = T_base_left_.translation();
  const double slope = std::tan(options_.max_ground_tilt);
  for (int v = SAMPLE_STEP_PX / 2; v < camera_.height; v += SAMPLE_STEP_PX)
  {
    const auto* row = disparity.ptr<float>(v);
    for (int u = SAMPLE_STEP_PX / 2; u < camera_.width; u += SAMPLE_STEP_PX)
    {
      const float d = row[u];
      if (!(d > 0.5F))
      {
        continue;
      }
      const double depth = camera_.fb / d;
      const Eigen::Vector3d p = R * (depth * camera_.ray(u, v)) + t;
      const double noise = 2.0 * depth / d * DISPARITY_SIGMA_PX * std::abs((t.z() - p.z()) / depth);
      if (std::abs(p.z()) <= options_.max_ground_step_m + slope * p.head<2>().norm() + noise &&
          p.x() < options_.max_range_m)
      {
        samples_.push_back({static_cast<float>(u), static_cast<float>(v), d});
      }
    }
  }
}

bool GroundEstimator::search(Eigen::Vector3d* abc)
{
  if (samples_.size() < MIN_INLIERS)
  {
    return false;
  }
  const size_t step = std::max<size_t>(1, samples_.size() / SCORED_SAMPLES);
  double best = -1e9;
  // What is below the ground cannot be seen: of two planes with as many points, the lower one is the ground.
  const auto score = [&](const Eigen::Vector3d& candidate)
  {
    double sum = 0.0;
    for (size_t i = 0; i < samples_.size(); i += step)
    {
      const Sample& s = samples_[i];
      const double r = s.disparity - (candidate.x() * s.u + candidate.y() * s.v + candidate.z());
      const double limit = tolerance(s.disparity);
      sum += std::abs(r) < limit ? 1.0 : r < 0.0 ? -1.0 : 0.0;
    }
    if (sum > best)
    {
      best = sum;
      *abc = candidate;
    }
  };
  score(coefficients(toDisparity(plane_)));
  score(coefficients(toDisparity(GroundPlane())));
  std::uniform_int_distribution<size_t> pick(0, samples_.size() - 1);
  for (int i = 0; i < HYPOTHESES; ++i)
  {
    Eigen::Matrix3d A;
    Eigen::Vector3d d;
    for (int row = 0; row < 3; ++row)
    {
      const Sample& s = samples_[pick(random_)];
      A.row(row) << s.u, s.v, 1.0;
      d(row) = s.disparity;
    }
    GroundPlane plane;
    if (std::abs(A.determinant()) < 2.0 * MIN_TRIANGLE * camera_.width * camera_.height)
    {
      continue;
    }
    const Eigen::Vector3d candidate = A.partialPivLu().solve(d);
    if (toBase(candidate, &plane))
    {
      score(candidate);
    }
  }
  return true;
}

bool GroundEstimator::refine(const Eigen::Vector3d& prior, Eigen::Vector3d* abc) const
{
  const DisparityPlane last = toDisparity(plane_);
  size_t inliers = 0;
  size_t below = 0;
  double spread = 0.0;  // of the inliers' disparities, in tolerances
  for (int round = 0; round < REFINEMENTS; ++round)
  {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    const auto add = [&](double u, double v, double disparity, double weight)
    {
      const Eigen::Vector3d row(u, v, 1.0);
      information += weight * row * row.transpose();
      sum += weight * disparity * row;
    };
    // The last plane counts as if it was seen at four points.
    const double tilt_px = camera_.fb / last.camera_height_m * tilt_sigma_;
    for (const double u : {0.0, static_cast<double>(camera_.width)})
    {
      for (const double v : {0.55 * camera_.height, static_cast<double>(camera_.height)})
      {
        const double d = Eigen::Vector3d(u, v, 1.0).dot(prior);
        add(u, v, d, 1.0 / (tilt_px * tilt_px + std::pow(PRIOR_HEIGHT_PART * d, 2)));
      }
    }
    const double information_of_sample = 1.0 / (SAMPLES_PER_INFORMATION * DISPARITY_SIGMA_PX * DISPARITY_SIGMA_PX);
    inliers = 0;
    below = 0;
    double sum_d = 0.0;
    double sum_d2 = 0.0;
    for (const Sample& s : samples_)
    {
      const double r = s.disparity - Eigen::Vector3d(s.u, s.v, 1.0).dot(*abc);
      const double limit = 1.5 * tolerance(s.disparity);
      const double x = r / limit;
      if (std::abs(x) < 1.0)
      {
        const double root = 1.0 - x * x;  // Tukey's biweight
        add(s.u, s.v, s.disparity, information_of_sample * root * root);
        ++inliers;
        sum_d += s.disparity;
        sum_d2 += s.disparity * s.disparity;
      }
      else if (x < 0.0)
      {
        ++below;
      }
    }
    *abc = information.ldlt().solve(sum);
    const double mean_d = sum_d / std::max<size_t>(1, inliers);
    const double variance = sum_d2 / std::max<size_t>(1, inliers) - mean_d * mean_d;
    spread = std::sqrt(std::max(0.0, variance)) / tolerance(mean_d);
  }
  return inliers >= MIN_INLIERS && spread >= MIN_SPREAD && 4 * below < 3 * inliers;
}

GroundPlane GroundEstimator::update(const cv::Mat& disparity, const std::optional<Eigen::Isometry3d>& T_odom_base)
{
  carry(T_odom_base);
  collect(disparity);
  Eigen::Vector3d abc;
  GroundPlane found;
  const Eigen::Vector3d prior = coefficients(toDisparity(plane_));
  if (search(&abc) && refine(prior, &abc) && toBase(abc, &found))
  {
    found.measured = true;
    plane_ = found;
    tilt_sigma_ = 0.0;
    pairs_without_ = 0;
    return plane_;
  }
  plane_.measured = false;
  if (++pairs_without_ >= FORGET_AFTER_PAIRS)
  {
    plane_ = GroundPlane();
    tilt_sigma_ = MOUNTING_TILT;
  }
  return plane_;
}

}  // namespace pi_detect::obstacles
