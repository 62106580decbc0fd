#include "front_end/stereo_geometry.h"

#include <cmath>

namespace pi_slam::front_end
{

StereoGeometry::StereoGeometry(const StereoCalibration& calibration) : calibration_(calibration)
{
  for (int from = LEFT; from <= RIGHT; ++from)
  {
    focal_[from] = 0.5 * (camera(from).fx + camera(from).fy);
    const Eigen::Isometry3d T_other_from = T_body_camera(1 - from).inverse() * T_body_camera(from);
    R_other_[from] = T_other_from.linear();
    p_other_[from] = T_other_from.translation();
  }
  baseline_m_ = p_other_[LEFT].norm();
}

double StereoGeometry::epipolarError(int from, const Eigen::Vector3d& bearing,
                                     const Eigen::Vector3d& other_bearing) const
{
  const Eigen::Vector3d normal = p_other_[from].cross(R_other_[from] * bearing);
  const double length = normal.norm();
  return length > 1e-9 ? focal_[1 - from] * std::abs(normal.dot(other_bearing)) / length : 0.0;
}

double StereoGeometry::inverseDistance(int from, const Eigen::Vector3d& bearing,
                                       const Eigen::Vector3d& other_bearing) const
{
  // other x (R bearing + rho p) = 0, by least squares for rho.
  const Eigen::Vector3d at_infinity = other_bearing.cross(R_other_[from] * bearing);
  const Eigen::Vector3d slope = other_bearing.cross(p_other_[from]);
  const double squared = slope.squaredNorm();
  return squared > 1e-18 ? -at_infinity.dot(slope) / squared : 0.0;
}

}  // namespace pi_slam::front_end
