#include "odometry/rig_calibrator.h"

#include <pi_node/durations.h>
#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "odometry/known_part.h"

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
constexpr double GYRO_RAD = 1e-3;      ///< of its turn in an interval
constexpr double FIRST_BIAS = 0.1;     ///< [rad/s]
constexpr double FIRST_NOISE = 2e-3;   ///< of a rotation by pictures [rad]
constexpr double TURN_WALK = 3e-5;     ///< [rad/sqrt(s)]: mounts bend with temperature
constexpr double LATE_WALK = 2e-5;     ///< [s/sqrt(s)]: clocks drift
constexpr double BIAS_WALK = 3e-4;     ///< errors of pictures in a row are alike [rad/s/sqrt(s)]
constexpr double ROTATION_GATE = 9.0;  ///< squared deviations beyond which a comparison counts less
constexpr int LEAST_COMPARED = 15;     ///< before a correction: 3 s of motion
/// What is less than this has no influence on the pose.
constexpr double LEAST_LATE_S = 0.7e-3;
constexpr double LEAST_TURN = 4e-3;
constexpr double SURE = 4.0;            ///< deviations
constexpr double KNOWN_TURN = 0.009;    ///< deviation of an angle that is taken over: a quarter of that at first [rad]
constexpr double LEAST_SCALE = 0.01;    ///< the turn by pictures is up to 0.6 % off itself, in forward motion
constexpr double KNOWN_SCALE = 2.5e-3;  ///< deviation of a scale that is taken over
/// Less in an interval is noise of the gyroscope, which is in its turn as well, or what pictures err: it would be taken
/// for a fault.
constexpr double LEAST_RATE_CHANGE = 0.02;  ///< [rad/s]
constexpr double LEAST_SCALED_TURN = 0.01;  ///< [rad]

Eigen::Vector3d aboveNoise(const Eigen::Vector3d& value, double least)
{
  return (value.array().abs() < least).select(Eigen::Vector3d::Zero(), value);
}

}  // namespace

RigCalibrator::RigCalibrator(const StereoCalibration& calibration, const ImuModel& model, const RigReport& before)
  : geometry_(calibration)
  , motion_check_(geometry_, RIG_TOLERANCE_PX)
  , variance_(FIRST_NOISE * FIRST_NOISE)
  , force_(model, before.p_body_imu - before.used.p_body_imu, before.p_body_imu_deviation)
  , used_(before.used)
{
  model.validate();
  x_.head<3>() = before.turn + logSo3(Eigen::Quaterniond(used_.R_body_imu));
  x_[LATE] = before.late_s - used_.late_s;
  x_.segment<3>(SCALE) = before.gyro_scale.cwiseQuotient(used_.gyro_scale) - Eigen::Vector3d::Ones();
  P_.topLeftCorner<4, 4>() = before.covariance;
  P_.diagonal().segment<3>(BIAS).setConstant(FIRST_BIAS * FIRST_BIAS);
  P_.diagonal().segment<3>(SCALE) = before.gyro_scale_deviation.cwiseAbs2();
}

void RigCalibrator::add(const FrameFeatures& features, const ImuBuffer& imu)
{
  const double since_s = pi_node::seconds(features.stamp_ns - reference_.stamp_ns);
  if (since_s > 0.0 && since_s < INTERVAL_S - 1e-3)
  {
    return;
  }
  if (!(since_s > 0.0 && since_s <= LONGEST_S && compare(features, imu)))
  {
    force_.skip();
  }
  reference_ = features;
}

/// @return false: the interval says nothing.
bool RigCalibrator::compare(const FrameFeatures& features, const ImuBuffer& imu)
{
  const int64_t from_ns = reference_.stamp_ns;
  const int64_t to_ns = features.stamp_ns;
  const int64_t rate_ns = std::llround(1e9 * RATE_S);
  ImuBias bias;
  bias.gyro = x_.segment<3>(BIAS);
  if (imu.empty() || imu.firstNs() > from_ns - rate_ns || imu.lastNs() < to_ns)
  {
    return false;
  }
  ImuBuffer::Quality quality;
  const ImuPreintegration by_gyro = imu.integrate(from_ns, to_ns, bias, &quality);
  Eigen::Vector3d w_from, w_to, w_mean, f, f_mean, w_deviation, f_deviation;
  if (by_gyro.empty() || quality.gap_s > 0.0 || quality.saturated ||
      !imu.statistics(from_ns - rate_ns, from_ns, &w_from, &f, &w_deviation, &f_deviation) ||
      !imu.statistics(to_ns - rate_ns, to_ns, &w_to, &f, &w_deviation, &f_deviation) ||
      !imu.statistics(from_ns, to_ns, &w_mean, &f_mean, &w_deviation, &f_deviation))
  {
    return false;
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
    return false;
  }

  // R_pictures = exp(-turn) exp(late w_from) R_gyro exp(-late w_to) exp(turn), to first order in all.
  const Eigen::Matrix3d R_to_from = by_gyro.deltaR().toRotationMatrix().transpose();
  const double dt = by_gyro.duration();
  const Eigen::Vector3d seen = logSo3(Eigen::Quaterniond(R_to_from * motion.R_now_last.transpose()));
  Eigen::Matrix<double, 3, 10> H;
  H.middleCols<3>(TURN) = Eigen::Matrix3d::Identity() - R_to_from;
  H.col(LATE) = aboveNoise(R_to_from * (w_from - bias.gyro) - (w_to - bias.gyro), LEAST_RATE_CHANGE);
  H.middleCols<3>(BIAS) = -dt * Eigen::Matrix3d::Identity();
  H.middleCols<3>(SCALE) = aboveNoise(-logSo3(by_gyro.deltaR()), LEAST_SCALED_TURN).asDiagonal();
  Vector10d walk;
  walk << Eigen::Vector3d::Constant(TURN_WALK), LATE_WALK, Eigen::Vector3d::Constant(BIAS_WALK),
      Eigen::Vector3d::Zero();
  P_.diagonal() += dt * walk.cwiseAbs2();
  // The bias of x_ is in `by_gyro` already.
  const Eigen::Vector3d error = seen - H.leftCols<4>() * x_.head<4>() - H.rightCols<3>() * x_.tail<3>();
  Eigen::Matrix3d S = H * P_ * H.transpose();
  S.diagonal().array() += variance_;
  const double squared = error.dot(S.llt().solve(error));
  S.diagonal().array() += squared > ROTATION_GATE ? variance_ * (squared / ROTATION_GATE - 1.0) : 0.0;
  const Eigen::Matrix<double, 10, 3> K = S.llt().solve(H * P_).transpose();
  x_ += K * error;
  P_ -= (K * H * P_).eval();
  P_ = (0.5 * (P_ + P_.transpose())).eval();
  ++compared_;
  const double left = (error - H * (K * error)).squaredNorm() / 3.0;
  variance_ += (std::min(left, ROTATION_GATE * variance_) - variance_) / std::min(50.0, 10.0 + compared_);
  // The gyroscope knows the turn better than pictures, in which turn and way look alike.
  motion.R_now_last = by_gyro.deltaR().conjugate().toRotationMatrix();
  if (!motion_check_.check(moved_, GYRO_RAD, &motion, &consistent_))
  {
    return false;
  }
  force_.add(motion, by_gyro, f_mean);
  return true;
}

std::optional<ImuCorrection> RigCalibrator::take()
{
  ImuCorrection correction;
  correction.p_body_imu = force_.take();
  bool due = !correction.p_body_imu.isZero();
  if (compared_ >= LEAST_COMPARED)
  {
    const Eigen::Vector3d turn =
        knownPart(x_.segment<3>(TURN), P_.block<3, 3>(TURN, TURN), KNOWN_TURN, SURE, LEAST_TURN);
    correction.R_body_imu = expSo3(-turn).toRotationMatrix();
    if (std::abs(x_[LATE]) > std::max(LEAST_LATE_S, SURE * std::sqrt(P_(LATE, LATE))))
    {
      correction.late_s = x_[LATE];
    }
    bool scaled = false;
    for (int i = 0; i < 3; ++i)
    {
      const double off = x_[SCALE + i];
      const double deviation = std::sqrt(P_(SCALE + i, SCALE + i));
      if (deviation < KNOWN_SCALE && std::abs(off) > std::max(LEAST_SCALE, SURE * deviation))
      {
        correction.gyro_scale[i] = 1.0 + off;
        scaled = true;
      }
    }
    if (!turn.isZero() || correction.late_s != 0.0 || scaled)
    {
      due = true;
      compared_ = 0;
      x_[LATE] -= correction.late_s;
      x_.segment<3>(TURN) -= turn;
      x_.segment<3>(SCALE) -= correction.gyro_scale - Eigen::Vector3d::Ones();
      x_.segment<3>(BIAS) = (correction.R_body_imu * x_.segment<3>(BIAS)).eval();
      force_.restart();  // it had compared with other ways
    }
  }
  if (!due)
  {
    return std::nullopt;
  }
  used_ = correction.after(used_);
  return correction;
}

RigReport RigCalibrator::report() const
{
  RigReport report;
  report.turn = x_.segment<3>(TURN) - logSo3(Eigen::Quaterniond(used_.R_body_imu));
  report.late_s = used_.late_s + x_[LATE];
  report.covariance = P_.topLeftCorner<4, 4>();
  report.gyro_scale = used_.gyro_scale.cwiseProduct(Eigen::Vector3d::Ones() + x_.segment<3>(SCALE));
  report.gyro_scale_deviation = P_.diagonal().segment<3>(SCALE).cwiseSqrt();
  report.p_body_imu = used_.p_body_imu + force_.place();
  report.p_body_imu_deviation = force_.placeDeviation();
  report.used = used_;
  return report;
}

}  // namespace pi_slam
