/// Normalised estimation error squared (NEES) of the sliding-window estimator and of the filter between keyframes, and
/// errors, over Monte Carlo runs on simulated drives.
///
///   bench_consistency [RUNS [SECONDS]]
///
/// Consistent is what stays near the degrees of freedom: above, the estimator believes too much in itself.
#include "estimator/consistency_run.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <map>
#include <vector>

int main(int argc, char** argv)
{
  const int runs = argc > 1 ? std::atoi(argv[1]) : 20;
  const double duration_s = argc > 2 ? std::atof(argv[2]) : 60.0;
  if (runs < 1 || !(duration_s >= 1.0 && duration_s <= 3600.0))
  {
    std::fprintf(stderr, "usage: bench_consistency [RUNS [SECONDS]], RUNS of at least 1, SECONDS in [1, 3600]\n");
    return 1;
  }
  struct Sum
  {
    double nees_pose = 0.0;
    double nees_position = 0.0;
    double nees_rotation = 0.0;
    double nees_heading = 0.0;
    double nees_state = 0.0;
    double squared_position = 0.0;
    double squared_rotation = 0.0;
    size_t count = 0;
  };
  try
  {
    ConsistencyOptions options;
    options.duration_s = duration_s;
    const pi_slam::SplineTrajectory trajectory = consistencyTrajectory(duration_s);
    const double slice_s = duration_s / 6.0;
    std::map<std::pair<bool, int>, Sum> sums;
    for (int run = 0; run < runs; ++run)
    {
      for (const ConsistencySample& sample : runConsistency(trajectory, options, static_cast<uint64_t>(run + 1)))
      {
        Sum& sum = sums[{sample.keyframe, static_cast<int>(std::ceil(sample.time_s / slice_s - 1e-9))}];
        sum.nees_pose += sample.nees_pose;
        sum.nees_position += sample.nees_position;
        sum.nees_rotation += sample.nees_rotation;
        sum.nees_heading += sample.nees_heading;
        sum.nees_state += sample.nees_state;
        sum.squared_position += sample.position_error_m * sample.position_error_m;
        sum.squared_rotation += sample.rotation_error_rad * sample.rotation_error_rad;
        ++sum.count;
      }
    }
    std::printf("%d runs of %.0f s, pixel noise %.1f px, keyframe every %.2f s, window of %d\n", runs, duration_s,
                options.pixel_noise, options.pair_interval_s * options.pairs_per_keyframe, options.window.keyframes);
    std::printf("%-9s %8s | NEES %6s %8s %8s %7s %7s | RMSE %8s %8s\n", "after", "until s", "pose/6", "posit/3",
                "rotat/3", "head/1", "all/15", "mm", "mrad");
    for (const auto& [key, sum] : sums)
    {
      const double count = static_cast<double>(sum.count);
      std::printf("%-9s %8.1f |      %6.2f %8.2f %8.2f %7.2f %7.2f |      %8.2f %8.3f\n",
                  key.first ? "keyframe" : "pair", slice_s * key.second, sum.nees_pose / count,
                  sum.nees_position / count, sum.nees_rotation / count, sum.nees_heading / count,
                  sum.nees_state / count, 1e3 * std::sqrt(sum.squared_position / count),
                  1e3 * std::sqrt(sum.squared_rotation / count));
    }
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "bench_consistency: %s\n", error.what());
    return 1;
  }
  return 0;
}
