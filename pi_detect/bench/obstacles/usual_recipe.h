#pragma once

#include <pi_detect/stereo_obstacles.h>

#include <opencv2/calib3d.hpp>

namespace pi_detect::bench
{

/// What many projects do: semi-global matching at full size, the ground where the mounting says it is, all points above
/// it in a grid of 0.2 m, groups of cells.
class UsualRecipe
{
public:
  UsualRecipe(const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
              const StereoObstacleOptions& options);

  std::vector<ObstacleMeasurement> detect(const cv::Mat& left, const cv::Mat& right);

private:
  StereoGeometry geometry_;
  Eigen::Isometry3d T_base_left_;
  StereoObstacleOptions options_;
  cv::Ptr<cv::StereoSGBM> matcher_;
};

}  // namespace pi_detect::bench
