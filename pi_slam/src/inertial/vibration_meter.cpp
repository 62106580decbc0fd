#include "inertial/vibration_meter.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>

#include <algorithm>
#include <cmath>

namespace pi_slam
{

namespace
{

constexpr double AVERAGE_S = 0.2;
constexpr double SENSOR_PART = 5.0;  ///< of the sensor's noise: a smooth flight comes to three in a fifth of a second
constexpr double LOUD = 1.0;         ///< worth a word [m/s^2]
constexpr double UNBEARABLE = 4.0;   ///< the IMU says little about speed then [m/s^2]

}  // namespace

VibrationMeter::VibrationMeter(const ImuModel& model) : model_(model) {}

void VibrationMeter::add(ImuSample* sample)
{
  const double longest_s = 2.5 / model_.rate_hz;
  if (last_[0] && last_[1] && pi_node::seconds(sample->stamp_ns - last_[1]->stamp_ns) <= 2.0 * longest_s &&
      !sample->saturated)
  {
    // (1, -2, 1) makes six times the power of white noise.
    const double part = std::min(1.0, 1.0 / (AVERAGE_S * model_.rate_hz));
    power_ += part * ((sample->f - 2.0 * last_[0]->f + last_[1]->f).cwiseAbs2() / 6.0 - power_);
  }
  last_[1] = last_[0];
  last_[0] = *sample;
  const double sensor = SENSOR_PART * model_.accel_noise_density;
  const double density = power_.maxCoeff() / model_.rate_hz - sensor * sensor;
  sample->f_shake = static_cast<float>(std::sqrt(std::max(0.0, density)));
  acceleration_ = static_cast<double>(sample->f_shake) * std::sqrt(model_.rate_hz);
}

std::string VibrationMeter::message() const
{
  if (acceleration_ < LOUD)
  {
    return std::string();
  }
  return pi_node::format(acceleration_ < UNBEARABLE ? "imu/data: shakes with %.1f m/s^2 (RMS), counts less for the "
                                                      "pose; mount the IMU on dampers, away from motor "
                                                      "and axles"
                                                    : "imu/data: shakes with %.1f m/s^2 (RMS), says nothing of the "
                                                      "speed any more: the pose comes from pictures and "
                                                      "wheels; mount the IMU on dampers, away from motor and axles",
                         acceleration_);
}

}  // namespace pi_slam
