#pragma once

#include <pi_bringup/euroc_dataset.h>

#include <Eigen/Core>

namespace pi_bringup
{

/// What turns a raw camera into a rectified one, in the convention of sensor_msgs/CameraInfo.
struct Rectification
{
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< raw optical frame to rectified optical frame
  Eigen::Matrix<double, 3, 4> P = Eigen::Matrix<double, 3, 4>::Zero();  ///< projection of the rectified camera [px]
};

struct StereoRectification
{
  Rectification left;
  Rectification right;  ///< P(0, 3) = -fx * baseline [px m]
};

/// Rectification of a single camera: undistorts only, keeps the intrinsics.
Rectification rectifyMono(const CameraCalibration& camera);

/// Rectification of a pair (Bouguet's method, cv::stereoRectify) with common principal points, cropped to valid pixels.
/// @throws std::invalid_argument if the two pictures differ in size.
StereoRectification rectifyStereo(const CameraCalibration& left, const CameraCalibration& right);

}  // namespace pi_bringup
