// Cost of the IMU's part: a pose per sample, and going on from a corrected state. Run: bench_propagation

#include "inertial/imu_preintegration.h"
#include "inertial/imu_propagator.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

using namespace pi_slam;

namespace
{

constexpr double RATE_HZ = 1000.0;
constexpr int SAMPLES = 5000;
constexpr int REPETITIONS = 9;

std::vector<ImuSample> makeSamples()
{
  std::vector<ImuSample> samples;
  for (int i = 0; i < SAMPLES; ++i)
  {
    const double t = i / RATE_HZ;
    samples.push_back(ImuSample{std::llround(1e9 * t) + 1, Eigen::Vector3d(0.3 * std::sin(2.0 * t), 0.2, 0.5),
                                Eigen::Vector3d(0.5 * std::sin(t), 0.3, 9.81)});
  }
  return samples;
}

/// Median over repetitions of the time for one of `count` things that `action` does [us].
template <typename Action>
double medianTime(int count, const Action& action)
{
  std::vector<double> times;
  for (int i = 0; i < REPETITIONS; ++i)
  {
    const auto begin = std::chrono::steady_clock::now();
    action();
    times.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count() /
                    count);
  }
  std::sort(times.begin(), times.end());
  return times[times.size() / 2];
}

std::string processor()
{
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);)
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

void print(const char* subject, double us, double per_second)
{
  std::printf("| %-44s | %9.3f us | %7.3f %% |\n", subject, us, 100.0 * 1e-6 * us * per_second);
}

}  // namespace

int main()
{
  ImuModel model;
  model.rate_hz = RATE_HZ;
  const std::vector<ImuSample> samples = makeSamples();
  double sink = 0.0;  // so that nothing is optimised away

  std::printf("%s, %u threads; median of %d runs; last column: of one core at a 1 kHz IMU, 20 corrections/s\n\n",
              processor().c_str(), std::thread::hardware_concurrency(), REPETITIONS);
  std::printf("| %-44s | %12s | %9s |\n|---|---|---|\n", "subject", "median", "load");

  // Baseline: what any strapdown integration has to do, without covariance.
  const auto strapdown = [&]
  {
    NavState now;
    for (int i = 1; i < SAMPLES; ++i)
    {
      const double dt = 1.0 / RATE_HZ;
      const Eigen::Vector3d before = now.q * samples[i - 1].f;
      const Eigen::Vector3d turn = 0.25 * dt * (samples[i - 1].w + samples[i].w);
      now.q = (now.q * Eigen::Quaterniond(1.0, turn.x(), turn.y(), turn.z())).normalized();
      const Eigen::Vector3d a = 0.5 * (before + now.q * samples[i].f) - Eigen::Vector3d(0.0, 0.0, 9.81);
      now.p += dt * now.v + 0.5 * dt * dt * a;
      now.v += dt * a;
    }
    sink += now.p.x();
  };
  print("baseline: integration without covariance", medianTime(SAMPLES - 1, strapdown), RATE_HZ);

  const auto preintegrate = [&]
  {
    ImuPreintegration integral(model, ImuBias());
    for (int i = 1; i < SAMPLES; ++i)
    {
      integral.append(samples[i - 1], samples[i]);
    }
    sink += integral.covariance()(0, 0);
  };
  print("ImuPreintegration::append", medianTime(SAMPLES - 1, preintegrate), RATE_HZ);

  NavState state;
  state.stamp_ns = samples.front().stamp_ns;
  for (const bool started : {false, true})
  {
    const auto stream = [&]
    {
      ImuPropagator propagator(model);
      if (started)
      {
        propagator.rebase(state, Matrix15d::Identity());
      }
      for (const ImuSample& sample : samples)
      {
        const auto pose = propagator.add(sample);
        sink += pose ? pose->state.p.x() : 0.0;
      }
    };
    print(started ? "ImuPropagator::add, pose and covariance" : "ImuPropagator::add, before the start",
          medianTime(SAMPLES, stream), RATE_HZ);
  }

  ImuPropagator propagator(model);
  for (const ImuSample& sample : samples)
  {
    propagator.add(sample);
  }
  for (const int count : {20, 100, 200})
  {
    state.stamp_ns = samples[static_cast<size_t>(SAMPLES - 1 - count)].stamp_ns;
    const std::string subject = "ImuPropagator::rebase over " + std::to_string(count) + " samples";
    const auto correct = [&]
    {
      for (int i = 0; i < 100; ++i)
      {
        sink += propagator.rebase(state, Matrix15d::Identity());
      }
    };
    print(subject.c_str(), medianTime(100, correct), 20.0);
  }
  std::printf("\n(%g)\n", sink);
  return 0;
}
