#include "initialization/rest_statistics.h"

#include <algorithm>
#include <cmath>

#include <pi_node/durations.h>

namespace pi_slam
{

namespace
{

constexpr int WINDOW_PARTS = 8;    ///< of a window
constexpr double LEVEL_S = 5.0;    ///< over which levels and baseline are averaged
constexpr double HELD_S = 10.0;    ///< likewise, without pictures that confirm: biases and temperature drift
constexpr double SETTLED_S = 0.8;  ///< from the beginning of a rest on: a vehicle that has braked rocks
constexpr double LEAST_KNOWN_S = 1.5;
constexpr double LEVELS = 3.0;     ///< of the deviation at rest: the deviation of eight means scatters by a quarter
constexpr double TURNING = 0.003;  ///< off the rate at rest, beside noise: a tenth of a degree in half a second [rad/s]
constexpr double GAINED_MPS = 0.03;  ///< a vehicle that has driven off
constexpr double GAINED_S = 3.0;     ///< in which it must have gained that: slower, the drift of a bias looks the same

}  // namespace

std::optional<ImuWindow> measureWindow(const ImuBuffer& imu, const ImuModel& model, int64_t end_ns, double length_s)
{
  const int64_t window_ns = std::llround(1e9 * length_s);
  if (imu.empty() || imu.lastNs() < end_ns || imu.firstNs() > end_ns - window_ns)
  {
    return std::nullopt;
  }
  // Five samples in each part, where there are as many.
  const int parts = std::clamp(static_cast<int>(length_s * model.rate_hz / 5.0), 2, WINDOW_PARTS);
  Eigen::Vector3d w_sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d w_squares = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_squares = Eigen::Vector3d::Zero();
  Eigen::Vector3d f_first = Eigen::Vector3d::Zero();
  for (int i = 0; i < parts; ++i)
  {
    Eigen::Vector3d w, f, w_deviation, f_deviation;
    const int64_t from_ns = end_ns - window_ns + i * window_ns / parts;
    if (!imu.statistics(from_ns, from_ns + window_ns / parts, &w, &f, &w_deviation, &f_deviation))
    {
      return std::nullopt;
    }
    f_first = i == 0 ? f : f_first;
    f -= f_first;  // gravity would cost digits
    w_sum += w;
    w_squares += w.cwiseAbs2();
    f_sum += f;
    f_squares += f.cwiseAbs2();
  }
  ImuWindow window;
  window.end_ns = end_ns;
  window.w = w_sum / parts;
  window.f = f_sum / parts;
  window.w_deviation = std::sqrt((w_squares / parts - window.w.cwiseAbs2()).cwiseMax(0.0).maxCoeff());
  window.f_deviation = std::sqrt((f_squares / parts - window.f.cwiseAbs2()).cwiseMax(0.0).maxCoeff());
  window.f += f_first;
  const double root = std::sqrt(parts / length_s);  // of a mean over one part
  window.w_noise = root * model.gyro_noise_density;
  window.f_noise = root * model.accel_noise_density;
  return window;
}

void RestStatistics::learn(const ImuWindow& window, bool confirmed)
{
  const double dt = std::clamp(pi_node::seconds(window.end_ns - last_ns_), 0.0, 0.2);
  last_ns_ = window.end_ns;
  if (baseline_s_ < SETTLED_S)
  {
    w_ = window.w;
    f_ = window.f;
    gained_.setZero();
  }
  const bool follow = confirmed || baseline_s_ < 3.0 * SETTLED_S;
  gained_ =
      follow ? Eigen::Vector3d::Zero() : Eigen::Vector3d((gained_ + dt * (window.f - f_)) * std::exp(-dt / GAINED_S));
  baseline_s_ += dt;
  const double part = dt / (follow ? std::clamp(baseline_s_, 0.5, LEVEL_S) : HELD_S);
  w_ += part * (window.w - w_);
  f_ += part * (window.f - f_);
  if (confirmed)
  {
    known_s_ += dt;
    const double level_part = std::min(1.0, dt / std::clamp(known_s_, dt, LEVEL_S));
    w_level_ += level_part * (window.w_deviation * window.w_deviation - w_level_);
    f_level_ += level_part * (window.f_deviation * window.f_deviation - f_level_);
  }
}

bool RestStatistics::quiet(const ImuWindow& window) const
{
  return known_s_ >= LEAST_KNOWN_S && window.w_deviation <= LEVELS * std::sqrt(w_level_) + window.w_noise &&
         window.f_deviation <= LEVELS * std::sqrt(f_level_) + window.f_noise;
}

bool RestStatistics::unmoved(const ImuWindow& window) const
{
  return quiet(window) && (window.w - w_).norm() <= TURNING + window.w_noise && gained_.norm() <= GAINED_MPS;
}

}  // namespace pi_slam
