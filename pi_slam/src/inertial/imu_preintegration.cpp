#include "inertial/imu_preintegration.h"

#include <pi_node/durations.h>
#include <pi_slam/so3.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "inertial/imu_step.h"

namespace pi_slam
{

namespace
{

void requireFinite(const ImuBias& bias)
{
  if (!bias.gyro.allFinite() || !bias.accel.allFinite())
  {
    throw std::invalid_argument("imu: bias is not finite");
  }
}

bool isBefore(const ImuSample& sample, int64_t stamp_ns)
{
  return sample.stamp_ns < stamp_ns;
}

}  // namespace

ImuPreintegration::ImuPreintegration(const ImuModel& model, const ImuBias& bias) : model_(model), bias_(bias)
{
  requireFinite(bias);
}

void ImuPreintegration::append(const ImuSample& from, const ImuSample& to, double noise_factor)
{
  if (to.stamp_ns <= from.stamp_ns)
  {
    throw std::invalid_argument("imu: interval ends at " + std::to_string(to.stamp_ns) + " ns, must be after " +
                                std::to_string(from.stamp_ns) + " ns, where it begins");
  }
  if (!empty() && from.stamp_ns != endNs())
  {
    throw std::invalid_argument("imu: interval begins at " + std::to_string(from.stamp_ns) + " ns, must begin at " +
                                std::to_string(endNs()) + " ns, where the integral ends");
  }
  if (!isPlausible(from) || !isPlausible(to))
  {
    throw std::invalid_argument("imu: sample in the interval from " + std::to_string(from.stamp_ns) +
                                " ns is not finite or above 1e6");
  }
  if (!(noise_factor >= 1.0 && noise_factor <= LARGEST_NOISE_FACTOR))
  {
    throw std::invalid_argument("imu: noise_factor = " + std::to_string(noise_factor) + ", must be in [1, 100000]");
  }
  intervals_.push_back({from, to, noise_factor});
  integrate(intervals_.back());
}

void ImuPreintegration::append(const ImuPreintegration& next)
{
  if (next.empty())
  {
    return;
  }
  if (!empty() && next.startNs() != endNs())
  {
    throw std::invalid_argument("imu: integral begins at " + std::to_string(next.startNs()) + " ns, must begin at " +
                                std::to_string(endNs()) + " ns, where the one before ends");
  }
  intervals_.reserve(intervals_.size() + next.intervals_.size());
  for (const Interval& interval : next.intervals_)
  {
    intervals_.push_back(interval);
    integrate(interval);
  }
}

void ImuPreintegration::reintegrate(const ImuBias& bias)
{
  requireFinite(bias);
  bias_ = bias;
  duration_s_ = 0.0;
  delta_R_.setIdentity();
  delta_v_.setZero();
  delta_p_.setZero();
  covariance_.setZero();
  bias_jacobian_.setZero();
  for (const Interval& interval : intervals_)
  {
    integrate(interval);
  }
}

void ImuPreintegration::integrate(const Interval& interval)
{
  const ImuStep step(interval.from, interval.to, bias_, delta_R_);
  step.propagate(model_, interval.noise_factor, &covariance_);

  // The same transition for the derivatives by the biases; rotations do not depend on that of the accelerometer.
  Eigen::Matrix<double, 3, 6> M;
  M.leftCols<3>() = step.V_theta * bias_jacobian_.block<3, 3>(3, 0) + step.V_bg;
  M.rightCols<3>() = step.V_ba;
  bias_jacobian_.topRows<3>() += step.dt * bias_jacobian_.bottomRows<3>() + 0.5 * step.dt * M;
  bias_jacobian_.block<3, 3>(3, 0) = step.Et * bias_jacobian_.block<3, 3>(3, 0) + step.T_bg;
  bias_jacobian_.bottomRows<3>() += M;

  delta_p_ += step.dt * delta_v_ + 0.5 * step.dt * step.dt * step.a_ref;
  delta_v_ += step.dt * step.a_ref;
  delta_R_ = step.q_ref_to;
  duration_s_ += step.dt;
}

Eigen::Quaterniond ImuPreintegration::correctedR(const ImuBias& bias) const
{
  return (delta_R_ * expSo3(bias_jacobian_.block<3, 3>(3, 0) * (bias.gyro - bias_.gyro))).normalized();
}

Eigen::Vector3d ImuPreintegration::correctedV(const ImuBias& bias) const
{
  return delta_v_ + bias_jacobian_.block<3, 3>(6, 0) * (bias.gyro - bias_.gyro) +
         bias_jacobian_.block<3, 3>(6, 3) * (bias.accel - bias_.accel);
}

Eigen::Vector3d ImuPreintegration::correctedP(const ImuBias& bias) const
{
  return delta_p_ + bias_jacobian_.block<3, 3>(0, 0) * (bias.gyro - bias_.gyro) +
         bias_jacobian_.block<3, 3>(0, 3) * (bias.accel - bias_.accel);
}

NavState ImuPreintegration::predict(const NavState& begin) const
{
  const double T = duration_s_;
  const Eigen::Vector3d gravity(0.0, 0.0, -model_.gravity);
  NavState end = begin;
  end.stamp_ns = begin.stamp_ns + (empty() ? 0 : endNs() - startNs());
  end.p = begin.p + T * begin.v + 0.5 * T * T * gravity + begin.q * correctedP(begin.bias);
  end.v = begin.v + T * gravity + begin.q * correctedV(begin.bias);
  end.q = (begin.q * correctedR(begin.bias)).normalized();
  return end;
}

void ImuPreintegration::transition(const NavState& begin, Matrix15d* F, Matrix15d* Q) const
{
  const Eigen::Matrix3d R = begin.q.toRotationMatrix();
  if (F != nullptr)
  {
    const Eigen::Vector3d turn = bias_jacobian_.block<3, 3>(3, 0) * (begin.bias.gyro - bias_.gyro);
    F->setIdentity();
    F->block<3, 3>(0, 3) = -R * hat(correctedP(begin.bias));
    F->block<3, 3>(0, 6).diagonal().setConstant(duration_s_);
    F->block<3, 6>(0, 9) = R * bias_jacobian_.topRows<3>();
    F->block<3, 3>(3, 3) = correctedR(begin.bias).conjugate().toRotationMatrix();
    F->block<3, 3>(3, 9) = rightJacobian(turn) * bias_jacobian_.block<3, 3>(3, 0);
    F->block<3, 3>(6, 3) = -R * hat(correctedV(begin.bias));
    F->block<3, 6>(6, 9) = R * bias_jacobian_.bottomRows<3>();
  }
  if (Q != nullptr)
  {
    *Q = covariance_;
    for (const int row : {0, 6})
    {
      Q->middleRows<3>(row) = (R * Q->middleRows<3>(row)).eval();
      Q->middleCols<3>(row) = (Q->middleCols<3>(row) * R.transpose()).eval();
    }
  }
}

ImuBuffer::ImuBuffer(const ImuModel& model) : model_(model), longest_interval_s_(std::max(5.0 / model.rate_hz, 0.025))
{
  model_.validate();
}

ImuBuffer::Added ImuBuffer::add(const ImuSample& sample)
{
  if (!isPlausible(sample))
  {
    return Added::NOT_FINITE;
  }
  if (!empty() && sample.stamp_ns <= lastNs())
  {
    return Added::OUT_OF_ORDER;
  }
  const bool gap = !empty() && pi_node::seconds(sample.stamp_ns - lastNs()) > longest_interval_s_;
  samples_.push_back(withoutSaturation(sample, empty() ? nullptr : &samples_.back(), model_));
  return gap ? Added::GAP : samples_.back().saturated ? Added::SATURATED : Added::OK;
}

ImuPreintegration ImuBuffer::integrate(int64_t from_ns, int64_t to_ns, const ImuBias& bias, Quality* quality) const
{
  if (to_ns <= from_ns)
  {
    throw std::invalid_argument("imu: integral ends at " + std::to_string(to_ns) + " ns, must be after " +
                                std::to_string(from_ns) + " ns, where it begins");
  }
  ImuPreintegration integral(model_, bias);
  Quality found;
  found.complete = !empty() && firstNs() <= from_ns && lastNs() >= to_ns;
  if (found.complete)
  {
    // The interval before `next` is the first one that ends after from_ns.
    auto next = std::upper_bound(samples_.begin(), samples_.end(), from_ns,
                                 [](int64_t stamp_ns, const ImuSample& sample) { return stamp_ns < sample.stamp_ns; });
    const auto last = std::lower_bound(next, samples_.end(), to_ns, isBefore);
    integral.intervals_.reserve(static_cast<size_t>(last - next) + 1);
    for (;; ++next)
    {
      const ImuSample& before = *(next - 1);
      const double distance_s = pi_node::seconds(next->stamp_ns - before.stamp_ns);
      const bool gap = distance_s > longest_interval_s_;
      found.gap_s = gap ? std::max(found.gap_s, distance_s) : found.gap_s;
      found.saturated = found.saturated || before.saturated || next->saturated;
      integral.append(before.stamp_ns < from_ns ? interpolate(before, *next, from_ns) : before,
                      next->stamp_ns > to_ns ? interpolate(before, *next, to_ns) : *next,
                      noiseFactor(before, *next, gap, model_.accel_noise_density));
      if (next == last)
      {
        break;
      }
    }
  }
  if (quality != nullptr)
  {
    *quality = found;
  }
  return integral;
}

bool ImuBuffer::statistics(int64_t from_ns, int64_t to_ns, Eigen::Vector3d* w_mean, Eigen::Vector3d* f_mean,
                           Eigen::Vector3d* w_deviation, Eigen::Vector3d* f_deviation) const
{
  const auto first = std::lower_bound(samples_.begin(), samples_.end(), from_ns, isBefore);
  auto end = first;
  Eigen::Vector3d w_sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_sum = Eigen::Vector3d::Zero();
  for (; end != samples_.end() && end->stamp_ns <= to_ns; ++end)
  {
    w_sum += end->w;
    f_sum += end->f;
  }
  if (end - first < 3)
  {
    return false;
  }
  const double count = static_cast<double>(end - first);
  *w_mean = w_sum / count;
  *f_mean = f_sum / count;
  Eigen::Vector3d w_squares = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_squares = Eigen::Vector3d::Zero();
  for (auto sample = first; sample != end; ++sample)
  {
    w_squares += (sample->w - *w_mean).cwiseAbs2();
    f_squares += (sample->f - *f_mean).cwiseAbs2();
  }
  *w_deviation = (w_squares / (count - 1.0)).cwiseSqrt();
  *f_deviation = (f_squares / (count - 1.0)).cwiseSqrt();
  return true;
}

void ImuBuffer::correct(const ImuCorrection& correction)
{
  correction.correct(&samples_);
}

void ImuBuffer::holdUntil(int64_t stamp_ns)
{
  if (!empty() && lastNs() < stamp_ns)
  {
    samples_.push_back(samples_.back());
    samples_.back().stamp_ns = stamp_ns;
  }
}

void ImuBuffer::forgetBefore(int64_t stamp_ns)
{
  const auto after = std::upper_bound(samples_.begin(), samples_.end(), stamp_ns,
                                      [](int64_t stamp, const ImuSample& sample) { return stamp < sample.stamp_ns; });
  if (after - samples_.begin() > 1)
  {
    samples_.erase(samples_.begin(), after - 1);
  }
}

}  // namespace pi_slam
