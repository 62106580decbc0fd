#include "inertial/wheel_simulator.h"

#include <pi_node/durations.h>

#include <cmath>
#include <random>

namespace pi_slam
{

std::vector<WheelSample> simulateWheels(const SplineTrajectory& trajectory, const WheelSimulatorOptions& options)
{
  std::mt19937_64 engine(options.seed);
  std::normal_distribution<double> normal;
  std::vector<WheelSample> samples;
  const auto period_ns = static_cast<int64_t>(1e9 / options.rate_hz);
  for (int64_t stamp_ns = trajectory.startNs(); stamp_ns <= trajectory.endNs(); stamp_ns += period_ns)
  {
    const auto truth = trajectory.at(stamp_ns);
    WheelSample sample;
    sample.stamp_ns = stamp_ns;
    double factor = options.scale * (1.0 + options.noise * normal(engine));
    const double time_s = pi_node::seconds(stamp_ns - trajectory.startNs());
    for (const WheelSimulatorOptions::Slip& slip : options.slips)
    {
      factor *= time_s >= slip.from_s && time_s < slip.to_s ? slip.factor : 1.0;
    }
    const double forward = truth.T_world_body.linear().col(0).dot(truth.v_world);
    // A fitted path trembles where it rests; encoders do not.
    const bool stands = std::abs(forward) < 1e-3 && std::abs(truth.w_body.z()) < 2e-3;
    sample.v.x() = stands ? 0.0 : factor * forward;
    sample.yaw_rate = stands ? 0.0 : factor * truth.w_body.z();
    samples.push_back(sample);
  }
  return samples;
}

}  // namespace pi_slam
