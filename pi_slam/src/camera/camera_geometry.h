#pragma once

#include <pi_slam/stereo_calibration.h>

#include <Eigen/Core>
#include <array>

namespace pi_slam
{
namespace estimator
{

/// What the factors need of a camera.
struct CameraGeometry
{
  Eigen::Matrix3d R_camera_body = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_camera_body = Eigen::Vector3d::Zero();  ///< of the body's origin in the camera frame [m]
  double focal_px = 1.0;                                    ///< pixels per radian at the middle of the picture
  CameraModel model;
};
std::array<CameraGeometry, 2> cameraGeometry(const StereoCalibration& calibration);

}  // namespace estimator
}  // namespace pi_slam
