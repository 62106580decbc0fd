#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <cmath>

namespace pi_slam
{

/// What of a vector is known well enough to be taken over: its parts along the axes of its covariance whose deviation
/// is below `known`. 0, if none of them is more than `sure` deviations, or all together are not more than `least`: a
/// vehicle that turns about one axis does not tell an angle about it.
inline Eigen::Vector3d knownPart(const Eigen::Vector3d& value, const Eigen::Matrix3d& covariance, double known,
                                 double sure, double least)
{
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance);
  Eigen::Vector3d part = Eigen::Vector3d::Zero();
  bool is_sure = false;
  for (int i = 0; i < 3; ++i)
  {
    const double deviation = std::sqrt(axes.eigenvalues()[i]);
    if (deviation < known)
    {
      const Eigen::Vector3d axis = axes.eigenvectors().col(i);
      const double along = axis.dot(value);
      part += along * axis;
      is_sure = is_sure || std::abs(along) > sure * deviation;
    }
  }
  return is_sure && part.norm() > least ? part : Eigen::Vector3d::Zero();
}

}  // namespace pi_slam
