#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <random>
#include <vector>

#include "obstacles/matched_camera.h"

namespace pi_detect::obstacles
{

/// A plane in a disparity picture: its points (u, v) have the disparity a u + b v + c (exact for pinhole cameras).
struct DisparityPlane
{
  double a = 0.0;
  double b = 0.0;
  double c = 0.0;
  double camera_height_m = 1.0;  ///< of the camera above the plane
  double sigma_px = 0.0;         ///< error of its disparities, standard deviation [px]

  double at(double u, double v) const { return a * u + b * v + c; }
};

/// Fits the ground plane to disparity pictures: a robust fit close to the plane that the mounting implies. The plane of
/// the last pair, moved by the vehicle's motion where that is known, stabilises it where little ground is seen.
class GroundEstimator
{
public:
  GroundEstimator(const MatchedCamera& camera, const Eigen::Isometry3d& T_base_left,
                  const StereoObstacleOptions& options);

  /// @param disparity    CV_32FC1 of the camera's size.
  /// @param T_odom_base  pose of the vehicle at this pair, if known.
  GroundPlane update(const cv::Mat& disparity, const std::optional<Eigen::Isometry3d>& T_odom_base);

  /// The plane of the last update, for the disparity picture.
  DisparityPlane disparityPlane() const;

private:
  static constexpr int FORGET_AFTER_PAIRS = 20;  ///< without ground, the mounting's plane counts again

  struct Sample
  {
    float u;
    float v;
    float disparity;
  };

  DisparityPlane toDisparity(const GroundPlane& plane) const;
  /// @return false if the plane is too far from that of the mounting.
  bool toBase(const Eigen::Vector3d& abc, GroundPlane* plane) const;
  bool isWithinMounting(const GroundPlane& plane) const;
  /// Moves the plane of the last pair to the pose of this one.
  void carry(const std::optional<Eigen::Isometry3d>& T_odom_base);
  /// Samples pixels that could be ground: not further from the mounting's plane than the options allow.
  void collect(const cv::Mat& disparity);
  bool search(Eigen::Vector3d* abc);
  /// @return false if too little of the ground is seen.
  bool refine(const Eigen::Vector3d& prior, Eigen::Vector3d* abc) const;

  MatchedCamera camera_;
  Eigen::Isometry3d T_base_left_;
  StereoObstacleOptions options_;
  GroundPlane plane_;  ///< of the last pair; until ground is seen, that of the mounting
  double tilt_sigma_;  ///< of the plane [rad]
  int pairs_without_ = FORGET_AFTER_PAIRS;
  std::optional<Eigen::Isometry3d> T_odom_last_;
  std::vector<Sample> samples_;
  std::mt19937 random_{1};
};

}  // namespace pi_detect::obstacles
