#include <pi_detect/stereo_obstacles.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>

#include <pi_node/option_check.h>
#include "obstacles/disparity_matcher.h"
#include "obstacles/ground_estimator.h"
#include "obstacles/ground_viewer.h"
#include "obstacles/measure_surface.h"
#include "obstacles/surfaces.h"

namespace pi_detect
{

namespace
{

using pi_node::secondsSince;

using Clock = std::chrono::steady_clock;

constexpr double LEAST_DEPTH_M = 0.1;  // of what matching reaches, for a camera before the vehicle's front

void checkPicture(const char* name, const cv::Mat& picture, int type, const char* type_name,
                  const StereoGeometry& geometry)
{
  if (picture.cols != geometry.width || picture.rows != geometry.height)
  {
    throw std::invalid_argument(std::string(name) + ": " + pi_node::sizeText(picture.cols, picture.rows) +
                                ", the camera's calibration says " +
                                pi_node::sizeText(geometry.width, geometry.height));
  }
  if (picture.type() != type)
  {
    throw std::invalid_argument(std::string(name) + ": type " + cv::typeToString(picture.type()) + ", must be " +
                                type_name);
  }
}

const StereoObstacleOptions& validated(const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
                                       const StereoObstacleOptions& options)
{
  geometry.validate();
  options.validate();
  const double height = T_base_left.translation().z() - options.ground_z_m;
  if (!(height >= 0.1 && height <= 10.0))
  {
    throw std::invalid_argument("the left camera is " + std::to_string(height) +
                                " m above the ground of ground_z_m = " + std::to_string(options.ground_z_m) +
                                " m, must be 0.1 to 10: set ground_z_m to the ground's height in base_link, or correct "
                                "the camera's place in tf");
  }
  const double forward = T_base_left.linear()(0, 2);
  pi_node::OptionCheck("T_base_left").range("forward part of the optical axis", forward, 0.5, 1.0 + 1e-6);
  return options;
}

/// Along the optical axis nothing within range is further away than this.
double maxDepth(const Eigen::Isometry3d& T_ground_left, const StereoObstacleOptions& options)
{
  return options.max_range_m / T_ground_left.linear()(0, 2) + T_ground_left.translation().norm();
}

/// Depth along the optical axis of what is nearest_distance_m before the vehicle's front.
double minDepthWanted(const Eigen::Isometry3d& T_base_left, const StereoObstacleOptions& options)
{
  const double ahead_m = options.footprint.front + options.nearest_distance_m - T_base_left.translation().x();
  return std::max(LEAST_DEPTH_M, ahead_m / T_base_left.linear()(0, 2));
}

}  // namespace

void StereoGeometry::validate() const
{
  const pi_node::OptionCheck check("stereo geometry");
  check.range("width", width, 64, 8192);
  check.range("height", height, 48, 8192);
  check.range("fx", fx, 10.0, 1e5);
  check.range("fy", fy, 10.0, 1e5);
  check.range("cx", cx, -1.0 * width, 2.0 * width);
  check.range("cy", cy, -1.0 * height, 2.0 * height);
  check.range("baseline_m", baseline_m, 1e-3, 10.0);
  check.range("cx_difference", cx_difference, -0.5 * width, 0.5 * width);
}

void StereoObstacleOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("max_range_m", max_range_m, 1.0, 200.0);
  check.range("ground_z_m", ground_z_m, -10.0, 10.0);
  check.range("min_height_m", min_height_m, 0.02, 2.0);
  check.range("max_height_m", max_height_m, 0.1, 20.0);
  check.range("min_size_m", min_size_m, 0.02, 5.0);
  check.range("max_ground_tilt", max_ground_tilt, 0.0, 0.5);
  check.range("max_ground_step_m", max_ground_step_m, 0.0, 1.0);
  check.range("nearest_distance_m", nearest_distance_m, 0.0, 20.0);
  footprint.validate();
  if (min_height_m >= max_height_m)
  {
    throw std::invalid_argument("min_height_m = " + std::to_string(min_height_m) +
                                ", must be below max_height_m = " + std::to_string(max_height_m));
  }
}

class StereoObstacles::Implementation
{
public:
  Implementation(const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
                 const StereoObstacleOptions& options, std::shared_ptr<StereoStages> stages)
    : stages_(stages ? std::move(stages) : std::make_shared<StereoStages>(nullptr))
    , geometry_(geometry)
    , options_(validated(geometry, T_base_left, options))
    , T_ground_left_(Eigen::Translation3d(0.0, 0.0, -options.ground_z_m) * T_base_left)
    , matcher_(geometry, minDepthWanted(T_base_left, options), maxDepth(T_ground_left_, options))
    , matched_(matcher_.camera(), geometry, T_ground_left_, options)
    , given_(obstacles::MatchedCamera(geometry, geometry.width, geometry.height), geometry, T_ground_left_, options)
  {
  }

  Result detect(const cv::Mat& left, const cv::Mat& right, const PoseSource& pose)
  {
    checkPicture("left picture", left, CV_8UC1, "CV_8UC1", geometry_);
    checkPicture("right picture", right, CV_8UC1, "CV_8UC1", geometry_);
    const Clock::time_point start = Clock::now();
    cv::Mat disparity;
    stages_->match.run([&] { disparity = matcher_.compute(left, right); });
    const double disparity_s = secondsSince(start);
    Result result = find(disparity, matcher_.coarse(), pose, &matched_);
    result.disparity_s = disparity_s;
    if (disparity.size() == left.size())
    {
      disparity_ = disparity;
    }
    else
    {
      cv::resize(disparity, disparity_, left.size(), 0.0, 0.0, cv::INTER_NEAREST);
      cv::multiply(disparity_, static_cast<double>(left.cols) / disparity.cols, disparity_);
      disparity_.setTo(-1.0F, disparity_ <= 0.0F);
    }
    return result;
  }

  Result detect(const cv::Mat& disparity, const PoseSource& pose)
  {
    checkPicture("disparity", disparity, CV_32FC1, "CV_32FC1", geometry_);
    disparity.copyTo(disparity_);
    for (int v = 0; v < disparity_.rows; ++v)
    {
      auto* row = disparity_.ptr<float>(v);
      std::replace_if(
          row, row + disparity_.cols, [](float d) { return !(d > 0.0F && std::isfinite(d)); }, -1.0F);
    }
    return find(disparity_, cv::Mat(), pose, &given_);
  }

  double minDepth() const { return matcher_.minDepth(); }

  const cv::Mat& disparity() const { return disparity_; }

private:
  /// What depends on the size of the disparity picture.
  struct Stages
  {
    Stages(const obstacles::MatchedCamera& camera, const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
           const StereoObstacleOptions& options)
      : ground(camera, T_base_left, options)
      , surfaces(camera, options)
      , meter(camera, geometry, T_base_left, options)
      , viewer(camera, T_base_left, options)
    {
    }
    obstacles::GroundEstimator ground;
    obstacles::SurfaceFinder surfaces;
    obstacles::SurfaceMeter meter;
    obstacles::GroundViewer viewer;
  };

  Result find(const cv::Mat& disparity, const cv::Mat& coarse, const PoseSource& pose, Stages* stages)
  {
    std::optional<Eigen::Isometry3d> T_odom_ground = pose ? pose() : std::nullopt;
    if (T_odom_ground)
    {
      *T_odom_ground = *T_odom_ground * Eigen::Translation3d(0.0, 0.0, options_.ground_z_m);
    }
    Result result;
    stages_->find.run([&] { result = findAt(T_odom_ground, disparity, coarse, stages); });
    return result;
  }

  Result findAt(const std::optional<Eigen::Isometry3d>& T_odom_ground, const cv::Mat& disparity, const cv::Mat& coarse,
                Stages* stages) const
  {
    Result result;
    const Clock::time_point start = Clock::now();
    result.coverage = static_cast<double>(cv::countNonZero(disparity > 0.0F)) / static_cast<double>(disparity.total());
    result.ground = stages->ground.update(disparity, T_odom_ground);
    result.ground_s = secondsSince(start);
    const Clock::time_point ground_end = Clock::now();
    for (const obstacles::Surface& surface :
         stages->surfaces.find(disparity, stages->ground.disparityPlane(), maxDepth(T_ground_left_, options_)))
    {
      stages->meter.add(surface, &result.obstacles, &result.points);
    }
    result.view =
        stages->viewer.look(disparity, coarse, matcher_.coarseScale(), stages->ground.disparityPlane(), result.points);
    std::sort(result.obstacles.begin(), result.obstacles.end(),
              [](const ObstacleMeasurement& a, const ObstacleMeasurement& b)
              { return a.nearest.head<2>().squaredNorm() < b.nearest.head<2>().squaredNorm(); });
    toBase(&result);
    result.clusters_s = secondsSince(ground_end);
    return result;
  }

  void toBase(Result* result) const
  {
    const Eigen::Vector3d p_base_ground(0.0, 0.0, options_.ground_z_m);
    for (ObstacleMeasurement& obstacle : result->obstacles)
    {
      obstacle.min += p_base_ground;
      obstacle.max += p_base_ground;
      obstacle.nearest += p_base_ground;
    }
    for (Eigen::Vector3f& point : result->points)
    {
      point.z() += static_cast<float>(options_.ground_z_m);
    }
    result->ground.offset_m += result->ground.normal.dot(p_base_ground);
  }

  const std::shared_ptr<StereoStages> stages_;
  const StereoGeometry geometry_;
  const StereoObstacleOptions options_;
  const Eigen::Isometry3d T_ground_left_;  ///< ground: like base_link, but with its origin on the ground
  obstacles::DisparityMatcher matcher_;
  Stages matched_;
  Stages given_;
  cv::Mat disparity_;
};

StereoObstacles::StereoObstacles(const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
                                 const StereoObstacleOptions& options, std::shared_ptr<StereoStages> stages)
  : implementation_(std::make_unique<Implementation>(geometry, T_base_left, options, std::move(stages)))
{
}

StereoObstacles::~StereoObstacles() = default;

StereoObstacles::Result StereoObstacles::detect(const cv::Mat& left, const cv::Mat& right, const PoseSource& pose)
{
  return implementation_->detect(left, right, pose);
}

StereoObstacles::Result StereoObstacles::detect(const cv::Mat& disparity, const PoseSource& pose)
{
  return implementation_->detect(disparity, pose);
}

double StereoObstacles::minDepth() const
{
  return implementation_->minDepth();
}

const cv::Mat& StereoObstacles::disparity() const
{
  return implementation_->disparity();
}

}  // namespace pi_detect
