#include "inertial/imu_propagator.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cstdlib>

#include "inertial/imu_step.h"

namespace pi_slam
{

namespace
{

constexpr int64_t KEPT_NS = 5000000000LL;
constexpr int64_t UNCORRECTED_NS = 250000000LL;  ///< after which the wheels correct
constexpr int64_t SAME_TIME_NS = 30000000LL;     ///< of a sample of the wheels and the newest pose

}  // namespace

ImuPropagator::ImuPropagator(const ImuModel& model)
  : model_(model), longest_interval_s_(std::max(5.0 / model.rate_hz, 0.025))
{
  model_.validate();
}

std::optional<PropagatedState> ImuPropagator::add(const ImuSample& sample)
{
  if (!isPlausible(sample))
  {
    return std::nullopt;
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!samples_.empty() && sample.stamp_ns <= samples_.back().stamp_ns)
  {
    return std::nullopt;
  }
  const ImuSample held = withoutSaturation(sample, samples_.empty() ? nullptr : &samples_.back(), model_);
  const ImuSample before = samples_.empty() ? held : samples_.back();
  samples_.push_back(held);
  // The one at or before the oldest time is kept to interpolate with.
  while (samples_.size() > 2 && samples_[1].stamp_ns <= sample.stamp_ns - KEPT_NS)
  {
    samples_.pop_front();
  }
  if (!running_ || sample.stamp_ns < now_.state.stamp_ns)
  {
    return std::nullopt;
  }
  advance(before, held, &now_);
  return now_;
}

bool ImuPropagator::rebase(const NavState& state, const Matrix15d& covariance)
{
  if (!state.isFinite() || !(state.q.norm() > 0.5) || !covariance.allFinite() || covariance.diagonal().minCoeff() < 0.0)
  {
    return false;
  }
  PropagatedState now;
  now.state = state;
  now.state.q.normalize();
  now.covariance = covariance;

  const std::lock_guard<std::mutex> lock(mutex_);
  if (!samples_.empty() && state.stamp_ns < samples_.front().stamp_ns)
  {
    return false;
  }
  auto next = std::upper_bound(samples_.begin(), samples_.end(), state.stamp_ns,
                               [](int64_t stamp_ns, const ImuSample& sample) { return stamp_ns < sample.stamp_ns; });
  if (next != samples_.begin())
  {
    now.w_body = (next - 1)->w - state.bias.gyro;
  }
  for (; next != samples_.end(); ++next)
  {
    advance(*(next - 1), *next, &now);
  }
  now_ = now;
  rebased_ns_ = state.stamp_ns;
  running_ = true;
  return true;
}

void ImuPropagator::setWheels(const WheelOptions& options, const std::optional<WheelScale>& scale)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  wheels_ = options;
  scale_ = scale;
}

void ImuPropagator::addWheels(const WheelSample& sample)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (running_ && scale_ && now_.state.stamp_ns - rebased_ns_ > UNCORRECTED_NS &&
      std::abs(now_.state.stamp_ns - sample.stamp_ns) <= SAME_TIME_NS)
  {
    correctByWheels(sample, wheels_, *scale_, now_.state.v, now_.w_body, now_.state.q, &now_.state, &now_.covariance,
                    nullptr);
  }
}

void ImuPropagator::advance(const ImuSample& from, const ImuSample& to, PropagatedState* now) const
{
  NavState& state = now->state;
  const int64_t distance_ns = to.stamp_ns - std::min(from.stamp_ns, state.stamp_ns);
  const bool gap = pi_node::seconds(distance_ns) > longest_interval_s_;
  now->w_body = to.w - state.bias.gyro;
  if (to.stamp_ns == state.stamp_ns)
  {
    return;
  }
  // The state may be between two samples, or after the last of them.
  ImuSample begin = from.stamp_ns < state.stamp_ns ? interpolate(from, to, state.stamp_ns) : from;
  if (from.stamp_ns > state.stamp_ns || from.stamp_ns == to.stamp_ns)
  {
    begin.stamp_ns = state.stamp_ns;  // no sample before: the first one acts from the state on
  }
  const ImuStep step(begin, to, state.bias, state.q);
  const Eigen::Vector3d a = step.a_ref - Eigen::Vector3d(0.0, 0.0, model_.gravity);
  state.p += step.dt * state.v + 0.5 * step.dt * step.dt * a;
  state.v += step.dt * a;
  state.q = step.q_ref_to;
  state.stamp_ns = to.stamp_ns;
  step.propagate(model_, noiseFactor(from, to, gap, model_.accel_noise_density), &now->covariance);
}

void ImuPropagator::correct(const ImuCorrection& correction)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  correction.correct(&samples_);
}

void ImuPropagator::reset()
{
  const std::lock_guard<std::mutex> lock(mutex_);
  running_ = false;
}

std::optional<PropagatedState> ImuPropagator::newest() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return running_ ? std::optional<PropagatedState>(now_) : std::nullopt;
}

}  // namespace pi_slam
