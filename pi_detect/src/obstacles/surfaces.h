#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "obstacles/ground_estimator.h"
#include "obstacles/matched_camera.h"

namespace pi_detect::obstacles
{

/// A square of pixels that shows something above the ground.
struct Cell
{
  int column = 0;
  int row = 0;
  float disparity = 0.0F;  ///< of the nearer surface, if there are two [px]
  int pixels = 0;          ///< that show it
};

/// Cells that are connected in the picture and in depth.
struct Surface
{
  std::vector<Cell> cells;
  bool cut_left = false;  ///< its left end in the picture lies at the border or beside something nearer
  bool cut_right = false;
};

/// Finds connected surfaces above the ground.
class SurfaceFinder
{
public:
  static constexpr int CELL_PX = 4;

  SurfaceFinder(const MatchedCamera& camera, const StereoObstacleOptions& options);

  /// @param disparity  CV_32FC1 of the camera's size.
  /// @param max_depth_m  along the optical axis.
  const std::vector<Surface>& find(const cv::Mat& disparity, const DisparityPlane& ground, double max_depth_m);

private:
  void markCells(const cv::Mat& disparity, const DisparityPlane& ground, double max_depth_m);
  void connect();
  void smooth(Surface* surface);
  void findCuts(Surface* surface) const;

  MatchedCamera camera_;
  StereoObstacleOptions options_;
  int columns_;
  int rows_;
  std::vector<float> disparity_;  ///< per cell, 0: nothing
  std::vector<uint8_t> pixels_;
  std::vector<int> surface_of_;  ///< per cell, -1: none
  std::vector<int> queue_;
  std::vector<Surface> surfaces_;
};

}  // namespace pi_detect::obstacles
