#include "inertial/wheels.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>
#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace pi_slam
{

namespace
{

using pi_node::format;
using pi_node::seconds;

constexpr int64_t HELD_NS = 100000000;  ///< that the newest sample holds, and longest between two
constexpr int64_t CLOCK_JUMP_NS = 1000000000;
constexpr double REST_MPS = 0.002;           ///< a chassis that stands tells 0; a filtered one hardly more
constexpr double REST_RADPS = 0.005;         ///< of yaw rate, likewise
constexpr double MOVING_MPS = 0.005;         ///< mean speed that is motion
constexpr double SPEED_BELIEVED = 4.0;       ///< squared Mahalanobis distance up to which a speed counts in full
constexpr double SPEED_GATE = 16.0;          ///< and beyond which not at all
constexpr double CORRELATED_S = 0.1;         ///< errors of the wheels are independent after so long
constexpr double WAY_NOISE_M = 0.002;        ///< steps of encoders, backlash
constexpr double COMPARED_M = 1.0;           ///< way of one comparison with the pictures
constexpr double COMPARED_S = 4.0;           ///< slower is not compared: the pictures know scale by motion
constexpr double COMPARED_NOISE = 0.01;      ///< of one comparison: wheels 1 %
constexpr double SCALE_WALK = 1e-4;          ///< of the scale, by comparison: tyres warm up, load changes
constexpr double NAMED_SCALE_ERROR = 0.011;  ///< more is no matter of tyre pressure, and worth a message
constexpr double LARGEST_SCALE_ERROR = 0.2;  ///< that is a matter of tyres
constexpr int MAX_WRONG = 5;                 ///< comparisons in a row, after which it is no slip
constexpr int MAX_WRONG_TURNS = 2;           ///< likewise of the turns
constexpr double COMPARED_TURN = 0.3;        ///< of the gyroscope, that tells the sign of the wheels' [rad]

}  // namespace

void WheelOptions::validate() const
{
  const pi_node::OptionCheck check("wheels");
  check.range("scale_deviation", scale_deviation, 0.001, 0.3);
  check.positive("speed_noise", speed_noise);
  check.range("speed_noise_ratio", speed_noise_ratio, 0.0, 0.5);
  check.positive("side_noise", side_noise);
  check.positive("up_noise", up_noise);
}

void WheelWay::append(const WheelWay& next, const Eigen::Matrix3d& R)
{
  moved += R * next.moved;
  length += next.length;
  duration += next.duration;
  valid = valid && next.valid;
}

std::string scaleComplaint(const WheelScale& scale)
{
  const double error = scale.value - 1.0;
  if (std::abs(error) < std::max(NAMED_SCALE_ERROR, 4.0 * scale.deviation))
  {
    return "";
  }
  return format("the cameras measure %.1f %% ", 100.0 * std::abs(error)) + (error > 0.0 ? "more" : "less") +
         " way than the wheels; check the cameras' baseline in the calibration, and the wheels' radius";
}

Eigen::Vector3d WheelWay::deviation(const WheelOptions& options, const WheelScale& scale) const
{
  // Half of the noise that is part of the speed is the same from step to step.
  const double root = std::sqrt(CORRELATED_S * duration);
  const double part =
      0.5 * options.speed_noise_ratio * (length + std::sqrt(CORRELATED_S / std::max(duration, 0.1)) * length);
  return {std::sqrt(WAY_NOISE_M * WAY_NOISE_M + part * part + std::pow(scale.deviation * length, 2) +
                    std::pow(options.speed_noise * root, 2)),
          std::hypot(std::hypot(WAY_NOISE_M, part), options.side_noise * root),
          std::hypot(std::hypot(WAY_NOISE_M, part), options.up_noise * root)};
}

bool WheelBuffer::add(const WheelSample& sample)
{
  if (!sample.isFinite() ||
      (!empty() && sample.stamp_ns <= newest().stamp_ns && newest().stamp_ns - sample.stamp_ns < CLOCK_JUMP_NS))
  {
    return false;
  }
  if (!empty() && sample.stamp_ns <= newest().stamp_ns)
  {
    samples_.clear();  // the clock was set back
  }
  samples_.push_back(sample);
  return true;
}

std::optional<WheelSample> WheelBuffer::mean(int64_t from_ns, int64_t to_ns) const
{
  if (empty() || to_ns <= from_ns || samples_.front().stamp_ns > from_ns || newest().stamp_ns + HELD_NS < to_ns)
  {
    return std::nullopt;
  }
  WheelSample sum;
  sum.stamp_ns = to_ns;
  const auto add = [&](const WheelSample& a, const WheelSample& b)
  {
    const int64_t begin_ns = std::max(a.stamp_ns, from_ns);
    const int64_t end_ns = std::min(b.stamp_ns, to_ns);
    const double part = seconds(end_ns - begin_ns) / seconds(to_ns - from_ns);
    const double middle =
        (0.5 * seconds(begin_ns - a.stamp_ns) + 0.5 * seconds(end_ns - a.stamp_ns)) / seconds(b.stamp_ns - a.stamp_ns);
    sum.v += part * ((1.0 - middle) * a.v + middle * b.v);
    sum.yaw_rate += part * ((1.0 - middle) * a.yaw_rate + middle * b.yaw_rate);
  };
  auto next = std::upper_bound(samples_.begin(), samples_.end(), from_ns,
                               [](int64_t stamp_ns, const WheelSample& sample) { return stamp_ns < sample.stamp_ns; });
  for (;; ++next)
  {
    const bool held = next == samples_.end();
    WheelSample end = held ? newest() : *next;
    end.stamp_ns = held ? to_ns : end.stamp_ns;
    const WheelSample& begin = *(next - 1);
    if (end.stamp_ns > begin.stamp_ns && std::max(begin.stamp_ns, from_ns) < to_ns)
    {
      if (end.stamp_ns - begin.stamp_ns > HELD_NS)
      {
        return std::nullopt;
      }
      add(begin, end);
    }
    if (held || end.stamp_ns >= to_ns)
    {
      return sum;
    }
  }
}

std::optional<bool> WheelBuffer::atRest(int64_t from_ns, int64_t to_ns) const
{
  const std::optional<WheelSample> average = mean(from_ns, to_ns);
  if (!average)
  {
    return std::nullopt;
  }
  const bool rest = std::all_of(samples_.begin(), samples_.end(),
                                [&](const WheelSample& sample)
                                {
                                  return sample.stamp_ns < from_ns || sample.stamp_ns > to_ns ||
                                         (sample.v.norm() <= REST_MPS && std::abs(sample.yaw_rate) <= REST_RADPS);
                                });
  return rest ? std::optional(true) : average->v.norm() > MOVING_MPS ? std::optional(false) : std::nullopt;
}

void WheelBuffer::forgetBefore(int64_t stamp_ns)
{
  while (samples_.size() > 1 && samples_[1].stamp_ns <= stamp_ns)
  {
    samples_.pop_front();
  }
}

WheelVerdict correctByWheels(const WheelSample& wheels, const WheelOptions& options, const WheelScale& scale,
                             const Eigen::Vector3d& speed, const Eigen::Vector3d& w_body, const Eigen::Quaterniond& q,
                             NavState* state, Matrix15d* covariance, double* residual)
{
  const Eigen::Matrix3d R = options.T_body_wheels.linear().transpose();  // R_wheels_body
  const Eigen::Vector3d lever = options.T_body_wheels.translation();
  const Eigen::Vector3d v_body = q.conjugate() * speed;
  const Eigen::Vector3d said(scale.value * wheels.v.x(), scale.value * wheels.v.y(), 0.0);
  const Eigen::Vector3d error = said - R * (v_body + w_body.cross(lever));
  if (residual != nullptr)
  {
    *residual = error.x();
  }
  Eigen::Matrix<double, 3, 15> H = Eigen::Matrix<double, 3, 15>::Zero();
  H.block<3, 3>(0, 3) = R * hat(v_body);
  H.block<3, 3>(0, 6) = R * q.conjugate().toRotationMatrix();
  H.block<3, 3>(0, 9) = R * hat(lever);
  const double part = options.speed_noise_ratio * said.norm();
  const Eigen::Vector3d noise(
      std::sqrt(std::pow(options.speed_noise, 2) + part * part + std::pow(scale.deviation * wheels.v.norm(), 2)),
      std::hypot(options.side_noise, part), std::hypot(options.up_noise, part));
  const Eigen::Matrix<double, 15, 3> PHt = *covariance * H.transpose();
  Eigen::Matrix3d S = H * PHt;
  S.diagonal() += noise.cwiseAbs2();
  const double distance = error.x() * error.x() / S(0, 0);
  const double side = error.y() * error.y() / S(1, 1);
  if (!(distance <= SPEED_GATE) || !(side <= SPEED_GATE))
  {
    return WheelVerdict::REFUSED;
  }
  const double weaker = std::max({1.0, distance / SPEED_BELIEVED, side / SPEED_BELIEVED});
  S.diagonal() += (weaker - 1.0) * noise.cwiseAbs2();
  const Eigen::Matrix<double, 15, 3> K = S.llt().solve(PHt.transpose()).transpose();
  state->boxPlus(K * error);
  *covariance -= (K * PHt.transpose()).eval();
  *covariance = (0.5 * (*covariance + covariance->transpose())).eval();
  return WheelVerdict::USED;
}

void WheelMonitor::add(const NavState& state, const WheelWay& way, double wheel_turn, double gyro_turn)
{
  if (!begin_ || !way.valid)
  {
    begin(state);
    return;
  }
  const Eigen::Matrix3d R = (begin_->q.conjugate() * state.q).toRotationMatrix();
  way_.append(way, (begin_->q.conjugate() * last_q_).toRotationMatrix());
  last_q_ = state.q;
  wheel_turn_ += wheel_turn;
  gyro_turn_ += gyro_turn;
  if (std::abs(gyro_turn_) > COMPARED_TURN)
  {
    wrong_turns_ = wheel_turn_ * gyro_turn_ < -0.25 * gyro_turn_ * gyro_turn_ ? wrong_turns_ + 1 : 0;
    turn_fault_ = wrong_turns_ < MAX_WRONG_TURNS
                      ? ""
                      : format(
                            "wheels: they turn by %.2f rad where the gyroscope turns by %.2f: the sign of angular.z "
                            "is wrong, left is positive; the wheels are not used",
                            wheel_turn_, gyro_turn_);
    wheel_turn_ = gyro_turn_ = 0.0;
  }
  const Eigen::Matrix3d R_wheels_body = options_.T_body_wheels.linear().transpose();
  const Eigen::Vector3d lever = options_.T_body_wheels.translation();
  const Eigen::Vector3d moved = begin_->q.conjugate() * (state.p - begin_->p) + R * lever - lever;
  const double went = moved.norm();
  if (std::max(went, way_.length) < COMPARED_M && way_.duration < COMPARED_S)
  {
    return;
  }
  if (std::max(went, way_.length) >= COMPARED_M)
  {
    const Eigen::Vector3d said = R_wheels_body * way_.moved;
    const Eigen::Vector3d really = R_wheels_body * moved;
    const Eigen::Vector3d direction =
        said.norm() > 0.1 * COMPARED_M ? Eigen::Vector3d(said.normalized()) : Eigen::Vector3d::UnitX();
    judge(really.dot(direction), (really - really.dot(direction) * direction).norm(), said.norm());
  }
  begin(state);
}

void WheelMonitor::begin(const NavState& state)
{
  begin_ = state;
  last_q_ = state.q;
  way_ = WheelWay();
}

/// One comparison: pictures say that the vehicle went `forward` along what the wheels `said`, and `side` across [m].
void WheelMonitor::judge(double forward, double side, double said)
{
  if (said < 0.1 * COMPARED_M)
  {
    wrong_ = forward > 0.5 * COMPARED_M || side > 0.5 * COMPARED_M ? wrong_ + 1 : 0;
    if (wrong_ >= MAX_WRONG)
    {
      fault_ = format(
          "wheels: they say that the vehicle stands, IMU and pictures that it went %.2f m: the encoders or "
          "their driver give nothing; the wheels are not used",
          std::hypot(forward, side));
    }
    return;
  }
  const double ratio = forward / said;
  if (std::abs(ratio - 1.0) > LARGEST_SCALE_ERROR || side > 0.3 * said)
  {
    if (++wrong_ >= MAX_WRONG)
    {
      const std::string end = "; the wheels are not used";
      fault_ = side > std::abs(forward)
                   ? format(
                         "wheels: the vehicle goes %.2f m across what they call forward in %.2f m: the frame is "
                         "wrong, check base_link and where the IMU is in it",
                         side, said) +
                         end
               : ratio < 0.0
                   ? format("wheels: %.2f m of theirs are %.2f m: the sign of linear.x is wrong, forward is positive",
                            said, forward) +
                         end
                   : format(
                         "wheels: %.2f m of theirs are %.2f m: their scale is wrong by a factor of %.3f, check the "
                         "unit (m/s) and the wheels' radius",
                         said, forward, ratio) +
                         end;
    }
    return;
  }
  wrong_ = 0;
  fault_.clear();
  // One dimension: measured = scale + noise, refused beyond three deviations (slip).
  const double variance = std::pow(scale_.deviation, 2) + SCALE_WALK * SCALE_WALK;
  const double noise = std::pow(COMPARED_NOISE, 2);
  const double error = ratio - scale_.value;
  if (error * error > 9.0 * (variance + noise))
  {
    return;
  }
  const double gain = variance / (variance + noise);
  scale_.value += gain * error;
  scale_.deviation = std::sqrt((1.0 - gain) * variance);
}

}  // namespace pi_slam
