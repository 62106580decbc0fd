#include "map/drift_filter.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "map/map_data.h"

namespace pi_slam::map
{

void DriftFilter::start(const Eigen::Isometry3d& T_odom_body, const Eigen::Isometry3d& T_map_odom,
                        const Eigen::Matrix4d& covariance)
{
  T_odom_body_ = T_odom_body;
  T_map_odom_ = T_map_odom;
  covariance_ = covariance;
}

void DriftFilter::predict(const Eigen::Isometry3d& T_odom_body)
{
  const Eigen::Vector3d step = T_map_odom_.linear() * (T_odom_body.translation() - T_odom_body_.translation());
  const double turned = Eigen::AngleAxisd(T_odom_body_.linear().transpose() * T_odom_body.linear()).angle();
  // An error of heading turns the step: d_p += d_heading z x step.
  Eigen::Matrix4d F = Eigen::Matrix4d::Identity();
  F(0, 3) = -step.y();
  F(1, 3) = step.x();
  covariance_ = F * covariance_ * F.transpose();
  const double length = step.norm();
  covariance_.diagonal().head<3>().array() += DRIFT_POSITION * DRIFT_POSITION * length;
  covariance_(3, 3) +=
      DRIFT_HEADING * DRIFT_HEADING * length + DRIFT_HEADING_PER_TURN * DRIFT_HEADING_PER_TURN * turned;
  T_odom_body_ = T_odom_body;
}

void DriftFilter::turn(const Eigen::Isometry3d& T_map_odom)
{
  Eigen::Matrix4d J = Eigen::Matrix4d::Identity();
  J.topLeftCorner<3, 3>() = T_map_odom.linear() * T_map_odom_.linear().transpose();
  covariance_ = J * covariance_ * J.transpose();
  T_map_odom_ = T_map_odom;
}

Eigen::Vector4d DriftFilter::difference(const PlaceMatch& place) const
{
  const Eigen::Matrix3d turn = place.T_map_odom.linear() * T_map_odom_.linear().transpose();
  Eigen::Vector4d d;
  d << place.T_map_body.translation() - T_map_body().translation(), std::atan2(turn(1, 0), turn(0, 0));
  return d;
}

DriftFilter::Innovation DriftFilter::innovation(const PlaceMatch& place) const
{
  const Eigen::Vector4d d = difference(place);
  const Eigen::Matrix4d S = covariance_ + place.covariance;
  return {d.head<3>().norm(), std::abs(d(3)), d.dot(S.ldlt().solve(d))};
}

void DriftFilter::update(const PlaceMatch& place)
{
  const Eigen::Vector4d d = difference(place);
  const Eigen::Matrix4d S = covariance_ + place.covariance;
  const Eigen::Matrix4d K = S.ldlt().solve(covariance_).transpose();
  const Eigen::Vector4d delta = K * d;
  const Eigen::Vector3d p = T_map_body().translation() + delta.head<3>();
  T_map_odom_.linear() = Eigen::AngleAxisd(delta(3), Eigen::Vector3d::UnitZ()) * T_map_odom_.linear();
  T_map_odom_.translation() = p - T_map_odom_.linear() * T_odom_body_.translation();
  const Eigen::Matrix4d I_K = Eigen::Matrix4d::Identity() - K;
  covariance_ = I_K * covariance_ * I_K.transpose() + K * place.covariance * K.transpose();
}

}  // namespace pi_slam::map
