#include "estimator/factors.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <optional>

namespace pi_slam::estimator
{

namespace
{

constexpr double BEHIND = 1000.0;
/// Standstill: deviations of pose and velocity.
constexpr double STILL_POSITION_M = 1e-3;
constexpr double STILL_ANGLE_RAD = 5e-4;
constexpr double STILL_SPEED_MPS = 5e-3;
/// Farther from the bias that the integral was made with, the first-order correction is not good enough.
constexpr double FAR_GYRO_BIAS = 5e-3;
constexpr double FAR_ACCEL_BIAS = 5e-2;

}  // namespace

std::array<CameraGeometry, 2> cameraGeometry(const StereoCalibration& calibration)
{
  std::array<CameraGeometry, 2> cameras;
  const MountedCamera* const mounted[2] = {&calibration.left, &calibration.right};
  for (int camera = 0; camera < 2; ++camera)
  {
    const Eigen::Isometry3d T_camera_body = mounted[camera]->T_body_camera.inverse();
    cameras[camera].R_camera_body = T_camera_body.linear();
    cameras[camera].p_camera_body = T_camera_body.translation();
    cameras[camera].model = mounted[camera]->model;
    cameras[camera].focal_px = 0.5 * (mounted[camera]->model.fx + mounted[camera]->model.fy);
  }
  return cameras;
}

Eigen::Matrix<double, 2, 3> tangentBasis(const Eigen::Vector3d& bearing)
{
  // The axis that is farthest from the bearing gives the first direction.
  Eigen::Vector3d::Index axis = 0;
  bearing.cwiseAbs().minCoeff(&axis);
  const Eigen::Vector3d first = bearing.cross(Eigen::Vector3d::Unit(axis)).normalized();
  Eigen::Matrix<double, 2, 3> basis;
  basis.row(0) = first;
  basis.row(1) = bearing.cross(first);
  return basis;
}

Eigen::Matrix<double, 2, 3> viewTangent(const CameraGeometry& camera, const Eigen::Vector3d& bearing)
{
  constexpr double STEP_RAD = 1e-4;
  const Eigen::Matrix<double, 2, 3> basis = tangentBasis(bearing);
  Eigen::Matrix2d scale;
  for (int axis = 0; axis < 2; ++axis)
  {
    const Eigen::Vector3d step = STEP_RAD * basis.row(axis).transpose();
    const std::optional<Eigen::Vector2d> after = camera.model.project(bearing + step);
    const std::optional<Eigen::Vector2d> before = camera.model.project(bearing - step);
    if (!after || !before)
    {
      return camera.focal_px * basis;
    }
    scale.col(axis) = (*after - *before) / (2.0 * STEP_RAD);
  }
  // Where the distortion nearly folds back, a pixel would be any angle.
  const double least = 0.2 * camera.focal_px;
  if (!(std::abs(scale.determinant()) > least * least))
  {
    return camera.focal_px * basis;
  }
  return scale * basis;
}

Eigen::Vector2d viewError(const CameraGeometry& camera, const Eigen::Vector3d& bearing,
                          const Eigen::Matrix<double, 2, 3>& tangent, const Eigen::Vector3d& p_body,
                          Eigen::Matrix<double, 2, 3>* J_body)
{
  const Eigen::Vector3d p_camera = camera.R_camera_body * p_body + camera.p_camera_body;
  const double distance = p_camera.norm();
  const Eigen::Vector3d direction = p_camera / distance;
  if (!(distance > 1e-6) || !(direction.dot(bearing) > 0.1))
  {
    if (J_body != nullptr)
    {
      J_body->setZero();
    }
    return Eigen::Vector2d::Constant(BEHIND);
  }
  const Eigen::Vector2d error = tangent * direction;
  if (J_body != nullptr)
  {
    // d direction / d p_camera = (I - n n^T) / |p|
    J_body->noalias() = (tangent - error * direction.transpose()) * (camera.R_camera_body / distance);
  }
  return error;
}

Eigen::Vector2d reprojectionError(const Eigen::Matrix3d& R_odom_body, const Eigen::Vector3d& p_odom_body,
                                  const CameraGeometry& camera, const Eigen::Vector3d& bearing,
                                  const Eigen::Matrix<double, 2, 3>& tangent, const Eigen::Vector3d& p_landmark,
                                  Eigen::Matrix<double, 2, 6>* J_pose, Eigen::Matrix<double, 2, 3>* J_landmark)
{
  const Eigen::Vector3d p_body = R_odom_body.transpose() * (p_landmark - p_odom_body);
  Eigen::Matrix<double, 2, 3> J_body;
  const bool derive = J_pose != nullptr || J_landmark != nullptr;
  const Eigen::Vector2d error = viewError(camera, bearing, tangent, p_body, derive ? &J_body : nullptr);
  if (derive)
  {
    const Eigen::Matrix<double, 2, 3> J_point = J_body * R_odom_body.transpose();
    if (J_pose != nullptr)
    {
      J_pose->setZero();
      if (error.x() != BEHIND)
      {
        J_pose->leftCols<3>() = -J_point;
        J_pose->rightCols<3>() = J_body * hat(p_body);
      }
    }
    if (J_landmark != nullptr)
    {
      *J_landmark = J_point;
    }
  }
  return error;
}

WheelTie::WheelTie(const WheelWay& way, const WheelOptions& options, const WheelScale& scale)
  : moved(scale.value * way.moved)
  , lever(options.T_body_wheels.translation())
  , weight(way.deviation(options, scale).cwiseInverse().asDiagonal() * options.T_body_wheels.linear().transpose())
{
}

Eigen::Vector3d WheelTie::error(const NavState& begin, const NavState& end, Eigen::Matrix<double, 3, 30>* J) const
{
  const Eigen::Matrix3d R_body_odom = begin.q.toRotationMatrix().transpose();
  const Eigen::Matrix3d R_begin_end = R_body_odom * end.q.toRotationMatrix();
  const Eigen::Vector3d went = R_body_odom * (end.p - begin.p);
  const Eigen::Vector3d turned = R_begin_end * lever;
  J->setZero();
  J->block<3, 3>(0, 0) = -weight * R_body_odom;
  J->block<3, 3>(0, 3) = weight * hat(went + turned);
  J->block<3, 3>(0, 15) = weight * R_body_odom;
  J->block<3, 3>(0, 18) = -weight * R_begin_end * hat(lever);
  return weight * (went + turned - lever - moved);
}

StateLink::StateLink(const ImuPreintegration& imu, const ImuModel& model, bool still)
  : imu_(imu), model_(model), still_(still)
{
  updateWeight();
}

void StateLink::updateWeight()
{
  if (still_)
  {
    Vector15d weight;
    const double root = std::sqrt(imu_.duration());
    weight << Eigen::Vector3d::Constant(1.0 / STILL_POSITION_M), Eigen::Vector3d::Constant(1.0 / STILL_ANGLE_RAD),
        Eigen::Vector3d::Constant(1.0 / STILL_SPEED_MPS),
        Eigen::Vector3d::Constant(1.0 / (model_.gyro_random_walk * root)),
        Eigen::Vector3d::Constant(1.0 / (model_.accel_random_walk * root));
    sqrt_information_ = weight.asDiagonal();
    return;
  }
  const Eigen::LLT<Matrix15d> factor(imu_.covariance());
  sqrt_information_ = factor.matrixL().solve(Matrix15d::Identity());
}

void StateLink::relinearize(const ImuBias& bias)
{
  if (!still_ && ((bias.gyro - imu_.bias().gyro).norm() > FAR_GYRO_BIAS ||
                  (bias.accel - imu_.bias().accel).norm() > FAR_ACCEL_BIAS))
  {
    imu_.reintegrate(bias);
    updateWeight();
  }
}

Vector15d StateLink::error(const NavState& begin, const NavState& end, Eigen::Matrix<double, 15, 30>* J) const
{
  const Eigen::Matrix3d R_body_odom = begin.q.toRotationMatrix().transpose();
  const Eigen::Matrix3d R_begin_end = R_body_odom * end.q.toRotationMatrix();
  Vector15d error;
  error.segment<3>(9) = end.bias.gyro - begin.bias.gyro;
  error.segment<3>(12) = end.bias.accel - begin.bias.accel;
  if (still_)
  {
    const Eigen::Vector3d moved = R_body_odom * (end.p - begin.p);
    const Eigen::Vector3d turned = logSo3(begin.q.conjugate() * end.q);
    error.segment<3>(0) = moved;
    error.segment<3>(3) = turned;
    error.segment<3>(6) = end.v;
    if (J != nullptr)
    {
      J->setZero();
      const Eigen::Matrix3d J_inverse = rightJacobianInverse(turned);
      J->block<3, 3>(0, 0) = -R_body_odom;
      J->block<3, 3>(0, 3) = hat(moved);
      J->block<3, 3>(0, 15) = R_body_odom;
      J->block<3, 3>(3, 3) = -J_inverse * R_begin_end.transpose();
      J->block<3, 3>(3, 18) = J_inverse;
      J->block<3, 3>(6, 21).setIdentity();
      J->block<6, 6>(9, 9) = -Matrix6d::Identity();
      J->block<6, 6>(9, 24).setIdentity();
      *J = sqrt_information_.diagonal().asDiagonal() * *J;
    }
    return sqrt_information_.diagonal().cwiseProduct(error);
  }

  const double dt = imu_.duration();
  const Eigen::Vector3d gravity(0.0, 0.0, -model_.gravity);
  const Eigen::Vector3d moved = R_body_odom * (end.p - begin.p - begin.v * dt - 0.5 * gravity * dt * dt);
  const Eigen::Vector3d faster = R_body_odom * (end.v - begin.v - gravity * dt);
  const Eigen::Quaterniond measured = imu_.correctedR(begin.bias);
  const Eigen::Vector3d turned = logSo3(measured.conjugate() * begin.q.conjugate() * end.q);
  error.segment<3>(0) = moved - imu_.correctedP(begin.bias);
  error.segment<3>(3) = turned;
  error.segment<3>(6) = faster - imu_.correctedV(begin.bias);
  if (J != nullptr)
  {
    const Eigen::Matrix<double, 9, 6>& by_bias = imu_.biasJacobian();
    const Eigen::Matrix3d J_inverse = rightJacobianInverse(turned);
    const Eigen::Vector3d correction = by_bias.block<3, 3>(3, 0) * (begin.bias.gyro - imu_.bias().gyro);
    J->setZero();
    J->block<3, 3>(0, 0) = -R_body_odom;
    J->block<3, 3>(0, 3) = hat(moved);
    J->block<3, 3>(0, 6) = -R_body_odom * dt;
    J->block<3, 6>(0, 9) = -by_bias.topRows<3>();
    J->block<3, 3>(0, 15) = R_body_odom;
    J->block<3, 3>(3, 3) = -J_inverse * R_begin_end.transpose();
    J->block<3, 3>(3, 9) = -J_inverse * expSo3(turned).toRotationMatrix().transpose() * rightJacobian(correction) *
                           by_bias.block<3, 3>(3, 0);
    J->block<3, 3>(3, 18) = J_inverse;
    J->block<3, 3>(6, 3) = hat(faster);
    J->block<3, 3>(6, 6) = -R_body_odom;
    J->block<3, 6>(6, 9) = -by_bias.bottomRows<3>();
    J->block<3, 3>(6, 21) = R_body_odom;
    J->block<6, 6>(9, 9) = -Matrix6d::Identity();
    J->block<6, 6>(9, 24).setIdentity();
    *J = sqrt_information_.triangularView<Eigen::Lower>() * *J;
  }
  return sqrt_information_.triangularView<Eigen::Lower>() * error;
}

}  // namespace pi_slam::estimator
