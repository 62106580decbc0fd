#pragma once

#include <pi_slam/stereo_calibration.h>
#include "front_end/frame_features.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

namespace pi_slam::front_end
{

/// Two calibrated cameras, numbered LEFT and RIGHT, and what follows from how they are mounted. Points are given by the
/// bearing in one camera and the inverse of their distance [1/m], so that far points need no special case.
class StereoGeometry
{
public:
  explicit StereoGeometry(const StereoCalibration& calibration);

  const CameraModel& camera(int index) const { return mounted(index).model; }
  const Eigen::Isometry3d& T_body_camera(int index) const { return mounted(index).T_body_camera; }
  double focal(int index) const { return focal_[index]; }  ///< mean of both focal lengths [px]
  /// Shift in the picture of a point that comes nearer by 1 / m of inverse distance [px m].
  double disparityScale() const { return baseline_m_ * 0.5 * (focal_[LEFT] + focal_[RIGHT]); }

  /// Direction, of any length, in which the other camera sees a point of camera `from`.
  Eigen::Vector3d transfer(int from, const Eigen::Vector3d& bearing, double inverse_distance) const
  {
    return R_other_[from] * bearing + inverse_distance * p_other_[from];
  }
  /// How far the other camera's bearing is from the epipolar plane [px].
  double epipolarError(int from, const Eigen::Vector3d& bearing, const Eigen::Vector3d& other_bearing) const;
  /// Inverse distance from camera `from` of the point that both see; below 0 if the rays part.
  double inverseDistance(int from, const Eigen::Vector3d& bearing, const Eigen::Vector3d& other_bearing) const;

private:
  const MountedCamera& mounted(int index) const { return index == LEFT ? calibration_.left : calibration_.right; }

  const StereoCalibration calibration_;
  double focal_[2];
  double baseline_m_;
  Eigen::Matrix3d R_other_[2];  ///< R_other_from
  Eigen::Vector3d p_other_[2];  ///< camera `from` in the other one's frame [m]
};

}  // namespace pi_slam::front_end
