#include "odometry/rig_calibrator.h"

#include <pi_node/durations.h>
#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace pi_slam
{

namespace
{

constexpr double INTERVAL_S = 0.2;  ///< of a comparison: longer, and features go out of sight
constexpr double LONGEST_S = 0.4;
constexpr double RATE_S = 0.02;  ///< over which the rate at an end is averaged
constexpr size_t LEAST_FEATURES = 25;
constexpr double RIG_TOLERANCE_PX = 1.5;
constexpr double FREE_RAD = 0.1;       ///< the gyroscope is only where the search begins
constexpr double FIRST_BIAS = 0.1;     ///< [rad/s]
constexpr double FIRST_NOISE = 2e-3;   ///< of a rotation by pictures [rad]
constexpr double TURN_WALK = 3e-5;     ///< [rad/sqrt(s)]: mounts bend with temperature
constexpr double LATE_WALK = 2e-5;     ///< [s/sqrt(s)]: clocks drift
constexpr double BIAS_WALK = 1e-4;     ///< [rad/s/sqrt(s)]
constexpr double ROTATION_GATE = 9.0;  ///< squared deviations beyond which a comparison counts less
constexpr int LEAST_COMPARED = 15;     ///< before a correction: 3 s of motion
/// What is less than this has no influence on the pose.
constexpr double LEAST_LATE_S = 0.7e-3;
constexpr double LEAST_TURN = 4e-3;
constexpr double SURE = 4.0;          ///< deviations
constexpr double KNOWN_TURN = 0.009;  ///< deviation of an angle that is taken over: a quarter of that at first [rad]

}  // namespace

RigCalibrator::RigCalibrator(const StereoCalibration& calibration, const ImuModel& model, const RigReport& before)
  : geometry_(calibration)
  , motion_check_(geometry_, RIG_TOLERANCE_PX)
  , variance_(FIRST_NOISE * FIRST_NOISE)
  , used_(before.used)
{
  model.validate();
  x_.head<3>() = before.turn + logSo3(Eigen::Quaterniond(used_.R_body_imu));
  x_[LATE] = before.late_s - used_.late_s;
  P_ = (FIRST_BIAS * FIRST_BIAS) * Matrix7d::Identity();
  P_.topLeftCorner<4, 4>() = before.covariance;
}

void RigCalibrator::add(const FrameFeatures& features, const ImuBuffer& imu)
{
  const double since_s = pi_node::seconds(features.stamp_ns - reference_.stamp_ns);
  if (since_s > 0.0 && since_s < INTERVAL_S - 1e-3)
  {
    return;
  }
  if (since_s > 0.0 && since_s <= LONGEST_S)
  {
    compare(features, imu);
  }
  reference_ = features;
}

void RigCalibrator::compare(const FrameFeatures& features, const ImuBuffer& imu)
{
  const int64_t from_ns = reference_.stamp_ns;
  const int64_t to_ns = features.stamp_ns;
  const int64_t rate_ns = std::llround(1e9 * RATE_S);
  ImuBias bias;
  bias.gyro = x_.segment<3>(BIAS);
  if (imu.empty() || imu.firstNs() > from_ns - rate_ns || imu.lastNs() < to_ns)
  {
    return;
  }
  ImuBuffer::Quality quality;
  const ImuPreintegration by_gyro = imu.integrate(from_ns, to_ns, bias, &quality);
  Eigen::Vector3d w_from, w_to, f, w_deviation, f_deviation;
  if (by_gyro.empty() || quality.gap_s > 0.0 || quality.saturated ||
      !imu.statistics(from_ns - rate_ns, from_ns, &w_from, &f, &w_deviation, &f_deviation) ||
      !imu.statistics(to_ns - rate_ns, to_ns, &w_to, &f, &w_deviation, &f_deviation))
  {
    return;
  }
  moved_.clear();
  auto was = reference_.features.begin();
  for (const FeatureObservation& is : features.features)
  {
    was = std::find_if(was, reference_.features.end(), [&](const FeatureObservation& f) { return f.id >= is.id; });
    const int camera = is.seen[LEFT] ? LEFT : RIGHT;
    if (was != reference_.features.end() && was->id == is.id && was->seen[LEFT] && was->seen[RIGHT])
    {
      const double inverse_m =
          geometry_.inverseDistance(camera, was->bearing[camera], was->bearing[LEFT + RIGHT - camera]);
      moved_.push_back({camera, was->bearing[camera], is.bearing[camera], true, std::max(0.0, inverse_m)});
    }
  }
  front_end::BodyMotion motion;
  motion.R_now_last = by_gyro.deltaR().conjugate().toRotationMatrix();
  if (moved_.size() < LEAST_FEATURES || !motion_check_.check(moved_, FREE_RAD, &motion, &consistent_))
  {
    return;
  }

  // R_pictures = exp(-turn) exp(late w_from) R_gyro exp(-late w_to) exp(turn), to first order in all.
  const Eigen::Matrix3d R_to_from = by_gyro.deltaR().toRotationMatrix().transpose();
  const double dt = by_gyro.duration();
  const Eigen::Vector3d seen = logSo3(Eigen::Quaterniond(R_to_from * motion.R_now_last.transpose()));
  Eigen::Matrix<double, 3, 7> H;
  H.middleCols<3>(TURN) = Eigen::Matrix3d::Identity() - R_to_from;
  H.col(LATE) = R_to_from * (w_from - bias.gyro) - (w_to - bias.gyro);
  H.middleCols<3>(BIAS) = -dt * Eigen::Matrix3d::Identity();
  Vector7d walk;
  walk << Eigen::Vector3d::Constant(TURN_WALK), LATE_WALK, Eigen::Vector3d::Constant(BIAS_WALK);
  P_.diagonal() += dt * walk.cwiseAbs2();
  // The bias of x_ is in `by_gyro` already.
  const Eigen::Vector3d error = seen - H.leftCols<4>() * x_.head<4>();
  Eigen::Matrix3d S = H * P_ * H.transpose();
  S.diagonal().array() += variance_;
  const double squared = error.dot(S.llt().solve(error));
  S.diagonal().array() += squared > ROTATION_GATE ? variance_ * (squared / ROTATION_GATE - 1.0) : 0.0;
  const Eigen::Matrix<double, 7, 3> K = S.llt().solve(H * P_).transpose();
  x_ += K * error;
  P_ -= (K * H * P_).eval();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  ++compared_;
  const double left = (error - H * (K * error)).squaredNorm() / 3.0;
  variance_ += (std::min(left, ROTATION_GATE * variance_) - variance_) / std::min(50.0, 10.0 + compared_);
}

std::optional<ImuCorrection> RigCalibrator::take()
{
  // A vehicle that turns about one axis does not tell the angle about it: of the turn only what is known counts.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(P_.topLeftCorner<3, 3>());
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  bool sure = false;
  for (int i = 0; i < 3; ++i)
  {
    const double deviation = std::sqrt(axes.eigenvalues()[i]);
    if (deviation < KNOWN_TURN)
    {
      const Eigen::Vector3d axis = axes.eigenvectors().col(i);
      const double angle = axis.dot(x_.segment<3>(TURN));
      turn += angle * axis;
      sure = sure || std::abs(angle) > SURE * deviation;
    }
  }
  if (!sure || turn.norm() <= LEAST_TURN)
  {
    turn.setZero();
  }
  const bool late = std::abs(x_[LATE]) > std::max(LEAST_LATE_S, SURE * std::sqrt(P_(LATE, LATE)));
  if (compared_ < LEAST_COMPARED || (!late && turn.isZero()))
  {
    return std::nullopt;
  }
  ImuCorrection correction;
  correction.late_s = late ? x_[LATE] : 0.0;
  correction.R_body_imu = expSo3(-turn).toRotationMatrix();
  x_[LATE] -= correction.late_s;
  x_.segment<3>(TURN) -= turn;
  x_.segment<3>(BIAS) = (correction.R_body_imu * x_.segment<3>(BIAS)).eval();
  used_ = correction.after(used_);
  compared_ = 0;
  return correction;
}

RigReport RigCalibrator::report() const
{
  RigReport report;
  report.turn = x_.segment<3>(TURN) - logSo3(Eigen::Quaterniond(used_.R_body_imu));
  report.late_s = used_.late_s + x_[LATE];
  report.covariance = P_.topLeftCorner<4, 4>();
  report.used = used_;
  return report;
}

}  // namespace pi_slam
