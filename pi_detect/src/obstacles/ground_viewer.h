#pragma once

#include <Eigen/Geometry>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "obstacles/ground_estimator.h"
#include "obstacles/matched_camera.h"

namespace pi_detect::obstacles
{

/// Looks along the ground, column by column of cells: how far it is free, and what stands on it. Columns count as
/// beams on the ground, which holds for cameras rolled by a few degrees at most. Not thread safe.
class GroundViewer
{
public:
  GroundViewer(const MatchedCamera& camera, const Eigen::Isometry3d& T_base_left, const StereoObstacleOptions& options);

  /// @param disparity  CV_32FC1 of the camera's size.
  /// @param coarse     the same at another size, for where it is unknown; may be empty. @param scale  of its
  /// disparities.
  /// @param points  of obstacles, in the frame of T_base_left.
  GroundView look(const cv::Mat& disparity, const cv::Mat& coarse, double scale, const DisparityPlane& ground,
                  const std::vector<Eigen::Vector3f>& points);

private:
  /// Whether most of the cell's pixels show the ground.
  bool showsGround(const DisparityPlane& ground, int column, int row) const;
  float disparityAt(int u, int v) const;
  /// Distance from the camera at which a row of pixels sees the ground; infinite at the horizon [m].
  double distanceAt(const DisparityPlane& ground, double u, double v) const;
  void seeFree(const DisparityPlane& ground, int column, GroundBeam* beam) const;
  void seeHits(std::vector<float>* distances, GroundBeam* beam) const;

  const MatchedCamera camera_;
  const Eigen::Isometry3d T_base_left_;
  const double max_range_m_;
  const int columns_;
  const int rows_;
  cv::Mat disparity_;  ///< of the pair that is looked at
  cv::Mat coarse_;
  double scale_ = 1.0;
  std::vector<std::vector<float>> distances_;  ///< of the obstacles' points, per column
};

}  // namespace pi_detect::obstacles
