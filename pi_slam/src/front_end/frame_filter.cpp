#include "front_end/frame_filter.h"

#include "estimator/window_problem.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace pi_slam
{

namespace
{

constexpr int MAX_ITERATIONS = 5;
constexpr double HUBER = 2.0;  ///< [standard deviations]
constexpr double GATE = 16.0;  ///< squared Mahalanobis distance, 2 degrees of freedom: one view in 3000 is beyond
constexpr double SMALL_STEP = 1e-5;
constexpr double FRAME_STILL_M = 5e-4;
constexpr double FRAME_STILL_RAD = 1e-4;
constexpr double FRAME_STILL_MPS = 5e-3;

struct Prepared
{
  const LandmarkView* view;
  Eigen::Matrix<double, 2, 3> tangent;
};

}  // namespace

FrameFilter::FrameFilter(const StereoCalibration& calibration, double pixel_noise)
  : cameras_(estimator::cameraGeometry(calibration)), pixel_noise_(pixel_noise)
{
}

void FrameFilter::reset(const NavState& state, const Matrix15d& covariance)
{
  state_ = state;
  covariance_ = covariance;
}

void FrameFilter::predict(const ImuPreintegration& since_last)
{
  Matrix15d F;
  Matrix15d Q;
  since_last.transition(state_, &F, &Q);
  state_ = since_last.predict(state_);
  covariance_ = (F * covariance_ * F.transpose() + Q).eval();
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
}

WheelVerdict FrameFilter::update(const WheelSample& mean, const WheelOptions& options, const WheelScale& scale,
                                 const NavState& before, double* residual)
{
  const double dt = 1e-9 * static_cast<double>(state_.stamp_ns - before.stamp_ns);
  const Eigen::Vector3d turn = logSo3(before.q.conjugate() * state_.q);
  return correctByWheels(mean, options, scale, (state_.p - before.p) / dt, turn / dt, before.q * expSo3(0.5 * turn),
                         &state_, &covariance_, residual);
}

FilterReport FrameFilter::update(const std::vector<LandmarkView>& views, int min_used)
{
  FilterReport report;
  const NavState predicted = state_;
  const Matrix15d information = covariance_.selfadjointView<Eigen::Lower>().llt().solve(Matrix15d::Identity());
  const Matrix6d pose_covariance = covariance_.topLeftCorner<6, 6>();

  // The gate is that of the prediction: S = J P J^T + J_l P_l J_l^T + 1.
  std::vector<Prepared> used;
  used.reserve(views.size());
  Eigen::Matrix3d R = state_.q.toRotationMatrix();
  Eigen::Matrix<double, 2, 6> J;
  Eigen::Matrix<double, 2, 3> J_landmark;
  for (const LandmarkView& view : views)
  {
    const estimator::CameraGeometry& camera = cameras_[view.camera];
    const Eigen::Matrix<double, 2, 3> tangent = estimator::viewTangent(camera, view.bearing) / pixel_noise_;
    const Eigen::Vector2d error =
        estimator::reprojectionError(R, state_.p, camera, view.bearing, tangent, view.p_odom, &J, &J_landmark);
    const Eigen::Matrix2d noise = Eigen::Matrix2d::Identity() + J_landmark * view.covariance * J_landmark.transpose();
    const Eigen::Matrix2d S = J * pose_covariance * J.transpose() + noise;
    if (!(error.dot(S.inverse() * error) <= GATE))
    {
      report.outliers.push_back(view.id);
      ++report.refused;
      continue;
    }
    used.push_back(Prepared{&view, noise.llt().matrixL().solve(tangent)});
  }
  report.outliers.erase(std::unique(report.outliers.begin(), report.outliers.end()), report.outliers.end());
  report.used = static_cast<int>(used.size());
  if (report.used < min_used)
  {
    return report;
  }

  Matrix15d H = information;
  bool done = false;
  while (!done && report.iterations < MAX_ITERATIONS)
  {
    ++report.iterations;
    H = information;
    Vector15d b = information * state_.boxMinus(predicted);
    R = state_.q.toRotationMatrix();
    Matrix6d H_pose = Matrix6d::Zero();
    Eigen::Matrix<double, 6, 1> b_pose = Eigen::Matrix<double, 6, 1>::Zero();
    for (const Prepared& prepared : used)
    {
      const LandmarkView& view = *prepared.view;
      const Eigen::Vector2d error = estimator::reprojectionError(R, state_.p, cameras_[view.camera], view.bearing,
                                                                 prepared.tangent, view.p_odom, &J, nullptr);
      double weight = 1.0;
      estimator::huberCost(error.squaredNorm(), HUBER, &weight);
      H_pose.noalias() += weight * J.transpose() * J;
      b_pose.noalias() += weight * J.transpose() * error;
    }
    H.topLeftCorner<6, 6>() += H_pose;
    b.head<6>() += b_pose;
    const Vector15d step = -H.llt().solve(b);
    if (!step.allFinite())
    {
      state_ = predicted;
      return report;
    }
    state_.boxPlus(step);
    done = step.head<6>().cwiseAbs().maxCoeff() < SMALL_STEP;
  }
  covariance_ = H.llt().solve(Matrix15d::Identity());
  report.updated = true;
  return report;
}

void FrameFilter::holdStill(const NavState& anchor, const Matrix15d& anchor_covariance)
{
  // Position, angle and velocity are measured; the biases follow by their correlation.
  using Vector9d = Eigen::Matrix<double, 9, 1>;
  using Matrix9d = Eigen::Matrix<double, 9, 9>;
  Vector9d noise;
  noise << Eigen::Vector3d::Constant(FRAME_STILL_M), Eigen::Vector3d::Constant(FRAME_STILL_RAD),
      Eigen::Vector3d::Constant(FRAME_STILL_MPS);
  NavState wanted = anchor;
  wanted.v.setZero();
  const Vector9d error = wanted.boxMinus(state_).head<9>();
  Matrix9d S = covariance_.topLeftCorner<9, 9>();
  S.diagonal() += noise.cwiseAbs2();
  const Eigen::Matrix<double, 15, 9> K = S.llt().solve(covariance_.topRows<9>()).transpose();
  state_.boxPlus(K * error);
  covariance_ -= (K * covariance_.topRows<9>()).eval();
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();

  state_.p = anchor.p;
  state_.q = anchor.q;
  state_.v.setZero();
  covariance_.topRows<6>().setZero();
  covariance_.leftCols<6>().setZero();
  covariance_.topLeftCorner<6, 6>() = anchor_covariance.topLeftCorner<6, 6>();
}

}  // namespace pi_slam
