/// Processor time of one optimisation of the window, by the own solver and by Ceres in turns on the same data.
///
///   bench_window [KEYFRAMES_TO_DRIVE]
#include "consistency_run.h"
#include "simulated_features.h"

#include "inertial/imu_preintegration.h"
#include <pi_slam/imu_simulator.h>
#include "estimator/window_estimator.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <vector>

using namespace pi_slam;

namespace
{

constexpr int64_t INTERVAL_NS = 200000000;
constexpr int ITERATIONS = 5;

struct Contender
{
  const char* name;
  WindowEstimator window;
  std::vector<double> add_ms;
  std::vector<double> optimize_ms;
  double iterations = 0.0;
};

double median(std::vector<double> values)
{
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

/// Time of this thread on a processor: what others do does not count [ms].
double processorMs()
{
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

}  // namespace

int main(int argc, char** argv)
{
  const int keyframes = argc > 1 ? std::atoi(argv[1]) : 150;
  if (keyframes < 20 || keyframes > 100000)
  {
    std::fprintf(stderr, "usage: bench_window [KEYFRAMES_TO_DRIVE], in [20, 100000]\n");
    return 1;
  }
  try
  {
    const SplineTrajectory trajectory = consistencyTrajectory(0.2 * keyframes + 1.0);
    const StereoCalibration calibration = StereoCalibration::makeForwardPair(752, 480, 0.11);
    SimulatedFeaturesOptions features;
    features.landmarks = 1500;
    features.max_features = 160;
    features.pixel_noise = 1.0;
    SimulatedFeatures world(trajectory, calibration, features);
    const ImuModel model;
    ImuBuffer imu(model);
    for (const ImuSample& sample :
         ImuSimulator(ImuSimulatorOptions())
             .simulate(trajectory, trajectory.startNs(), trajectory.startNs() + keyframes * INTERVAL_NS))
    {
      imu.add(sample);
    }
    WindowOptions options;
    options.max_iterations = ITERATIONS;
    WindowOptions with_ceres = options;
    with_ceres.solver = WindowSolver::CERES;
    Contender contenders[2] = {{"schur", WindowEstimator(calibration, model, options), {}, {}, 0.0},
                               {"ceres", WindowEstimator(calibration, model, with_ceres), {}, {}, 0.0}};
    int64_t stamp_ns = trajectory.startNs();
    NavState state;
    const SplineTrajectory::State start = trajectory.at(stamp_ns);
    state.stamp_ns = stamp_ns;
    state.p = start.T_world_body.translation();
    state.q = Eigen::Quaterniond(start.T_world_body.linear()).normalized();
    state.v = start.v_world;
    const FrameFeatures first = world.at(stamp_ns);
    for (Contender& contender : contenders)
    {
      contender.window.start(state, 1e-3 * Matrix15d::Identity(), first);
    }
    double landmarks = 0.0;
    double observations = 0.0;
    int counted = 0;
    for (int keyframe = 1; keyframe <= keyframes; ++keyframe)
    {
      stamp_ns += INTERVAL_NS;
      const FrameFeatures seen = world.at(stamp_ns);
      for (int turn = 0; turn < 2; ++turn)
      {
        Contender& contender = contenders[(keyframe + turn) % 2];
        const ImuPreintegration since =
            imu.integrate(stamp_ns - INTERVAL_NS, stamp_ns, contender.window.newest().bias, nullptr);
        const NavState predicted = since.predict(contender.window.newest());
        const double begin_ms = processorMs();
        contender.window.addKeyframe(predicted, seen, since, false);
        const double middle_ms = processorMs();
        const WindowReport report = contender.window.optimize(ITERATIONS);
        if (keyframe > options.keyframes)
        {
          contender.add_ms.push_back(middle_ms - begin_ms);
          contender.optimize_ms.push_back(processorMs() - middle_ms);
          contender.iterations += report.iterations;
          landmarks += 0.5 * report.landmarks;
          observations += 0.5 * report.observations;
          counted += turn;
        }
      }
    }
    std::printf("%d keyframes, window of %d, %.0f landmarks with %.0f observations on average\n", keyframes,
                options.keyframes, landmarks / counted, observations / counted);
    std::printf("%-8s %18s %18s %12s\n", "solver", "add, median ms", "optimize, med. ms", "iterations");
    for (const Contender& contender : contenders)
    {
      std::printf("%-8s %18.3f %18.3f %12.1f\n", contender.name, median(contender.add_ms),
                  median(contender.optimize_ms), contender.iterations / counted);
    }
    std::printf("ratio of the optimisations: %.1f\n",
                median(contenders[1].optimize_ms) / median(contenders[0].optimize_ms));
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "bench_window: %s\n", error.what());
    return 1;
  }
  return 0;
}
