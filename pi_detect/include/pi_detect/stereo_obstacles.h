#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/outline.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

namespace pi_detect
{

/// A rectified pair: both pictures have these intrinsics, rows are epipolar lines.
struct StereoGeometry
{
  int width = 0;   ///< [px]
  int height = 0;  ///< [px]
  double fx = 0.0;
  double fy = 0.0;
  double cx = 0.0;  ///< of the left camera
  double cy = 0.0;
  double baseline_m = 0.0;     ///< right camera's distance along x [m], > 0
  double cx_difference = 0.0;  ///< cx of the left camera - cx of the right one [px]; usually 0. Disparities here are
                               ///< without it: depth = fx * baseline / disparity

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A plane in base_link: points p with normal . p = offset.
struct GroundPlane
{
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< up
  double offset_m = 0.0;  ///< height of the plane at the frame's origin along the normal [m]
  bool measured = false;  ///< false: not enough of the ground was seen; the last one, or what the mounting says
};

struct StereoObstacleOptions
{
  /// On the ground, from the origin of base_link [m]. Where disparities are below 2 px, their noise makes obstacles.
  double max_range_m = 18.0;
  double ground_z_m =
      0.0;  ///< of the ground in base_link, where the vehicle stands level; below its origin: negative [m]
  double min_height_m = 0.15;       ///< above the ground, from which something is an obstacle [m]
  double max_height_m = 2.2;        ///< the vehicle passes below what is higher [m]
  double min_size_m = 0.25;         ///< smallest extent (height or width) of an obstacle [m]
  double max_ground_tilt = 0.12;    ///< between the ground and the mounting's idea of it [rad]
  double max_ground_step_m = 0.15;  ///< likewise at base_link [m]
  int max_disparity_px = 64;        ///< multiple of 16; nearer things than fx * baseline / this are not seen
  double downscale = 1.0;           ///< pictures are made smaller by this before matching, 1 to 4

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Something above the ground, as one stereo pair shows it.
struct ObstacleMeasurement
{
  Eigen::Vector3d min = Eigen::Vector3d::Zero();  ///< box around its points in base_link [m]
  Eigen::Vector3d max = Eigen::Vector3d::Zero();
  Eigen::Vector3d nearest = Eigen::Vector3d::Zero();         ///< robust nearest point (by distance on the ground) [m]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  ///< of nearest [m^2]
  /// Around what is seen of it, in base_link [m]; empty: unknown. No smaller than what is seen, but for single points.
  Outline outline;
  Box box;                 ///< in the left rectified picture [px]
  int points = 0;          ///< pixels that see it
  bool cut_left = false;   ///< it may go on beyond max.y: the picture ends there, or something nearer hides the rest
  bool cut_right = false;  ///< likewise beyond min.y
  bool piece = false;      ///< of a surface that was taken apart: where its ends are seen shifts with the view
};

/// Finds obstacles in stereo pairs: disparity, ground plane, what stands out of it, clusters. No classes.
/// Not thread safe; keeps the ground plane from pair to pair.
class StereoObstacles
{
public:
  /// @param T_base_left  left rectified optical frame (z forward, x right, y down) in base_link.
  /// @throws std::invalid_argument for options, geometry, or a camera that is not 0.1 to 10 m above the ground.
  StereoObstacles(const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_left,
                  const StereoObstacleOptions& options);
  ~StereoObstacles();
  StereoObstacles(const StereoObstacles&) = delete;
  StereoObstacles& operator=(const StereoObstacles&) = delete;

  struct Result
  {
    std::vector<ObstacleMeasurement> obstacles;  ///< nearest first
    GroundPlane ground;
    std::vector<Eigen::Vector3f> points;  ///< of the obstacles, in base_link, thinned out [m]
    double coverage = 0.0;     ///< part of the pixels that have a disparity; low in the dark or with a covered lens
    double disparity_s = 0.0;  ///< time that matching took; 0 if the disparity was given [s]
    double ground_s = 0.0;     ///< likewise the ground plane [s]
    double clusters_s = 0.0;   ///< likewise all that follows [s]
  };

  /// @param left, right  CV_8UC1, rectified, of the geometry's size. @throws std::invalid_argument otherwise.
  Result detect(const cv::Mat& left, const cv::Mat& right);
  /// @param disparity  CV_32FC1 [px] of the geometry's size, left reference; not above 0 or not finite: unknown.
  Result detect(const cv::Mat& disparity);

  /// The last pair's disparity, CV_32FC1 [px] at the geometry's size, for display. Unknown: -1.
  const cv::Mat& disparity() const;

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace pi_detect
