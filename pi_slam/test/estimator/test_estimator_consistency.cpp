#include "estimator/consistency_run.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <vector>

namespace
{

constexpr int RUNS = 20;
constexpr double DURATION_S = 30.0;

struct Means
{
  double nees_pose = 0.0;
  double nees_pose_at_end = 0.0;
  double squared_position = 0.0;
  size_t count = 0;
};

/// Means over runs and time, of keyframes after optimisation or of pairs after the filter.
Means meansOf(bool keyframes)
{
  static const std::vector<std::vector<ConsistencySample>> results = []
  {
    ConsistencyOptions options;
    options.duration_s = DURATION_S;
    const pi_slam::SplineTrajectory trajectory = consistencyTrajectory(DURATION_S);
    std::vector<std::vector<ConsistencySample>> all;
    for (int run = 0; run < RUNS; ++run)
    {
      all.push_back(runConsistency(trajectory, options, static_cast<uint64_t>(100 + run)));
    }
    return all;
  }();
  Means means;
  for (const std::vector<ConsistencySample>& samples : results)
  {
    double end = 0.0;
    for (const ConsistencySample& sample : samples)
    {
      if (sample.keyframe == keyframes)
      {
        means.nees_pose += sample.nees_pose;
        means.squared_position += sample.position_error_m * sample.position_error_m;
        ++means.count;
        end = sample.nees_pose;
      }
    }
    means.nees_pose_at_end += end / RUNS;
  }
  means.nees_pose /= static_cast<double>(means.count);
  means.squared_position /= static_cast<double>(means.count);
  return means;
}

/// 95 % of the mean of RUNS chi-square numbers of 6 degrees of freedom (normal approximation of 120 degrees), widened
/// by a quarter either way: Huber's weights leave a few percent of the information unused, and the second order of the
/// views adds a few percent of error.
constexpr double LINEARIZATION = 0.25;
const double HALF_BAND = 1.96 * std::sqrt(2.0 * 6.0 / RUNS);
const double LEAST = (6.0 - HALF_BAND) * (1.0 - LINEARIZATION);
const double MOST = (6.0 + HALF_BAND) * (1.0 + LINEARIZATION);

}  // namespace

// Errors of one run stay the same for seconds, so a mean over time counts little more than one number per run.

TEST(EstimatorConsistency, WindowIsAsWrongAsItSays)
{
  const Means means = meansOf(true);
  RecordProperty("nees_pose", std::to_string(means.nees_pose));
  EXPECT_GT(means.nees_pose, LEAST);
  EXPECT_LT(means.nees_pose, MOST);
}

TEST(EstimatorConsistency, WindowIsNotMoreSureAfterHalfAMinute)
{
  const Means means = meansOf(true);
  EXPECT_GT(means.nees_pose_at_end, LEAST);
  EXPECT_LT(means.nees_pose_at_end, MOST);
}

TEST(EstimatorConsistency, FilterBetweenKeyframesIsAsWrongAsItSays)
{
  const Means means = meansOf(false);
  EXPECT_GT(means.nees_pose, LEAST);
  EXPECT_LT(means.nees_pose, MOST);
}

TEST(EstimatorConsistency, DriftStaysSmall)
{
  // About 120 m/min of driving with one pixel of noise.
  EXPECT_LT(std::sqrt(meansOf(true).squared_position), 0.15);
}

/// Cameras that read their rows one after the other, in all of the 40 ms between two pictures, on a drive that pitches
/// and rolls by 0.2 rad/s.
TEST(RollingShutter, CostsLittleOnceItIsStraightened)
{
  const auto positionError = [](double readout_s, bool straighten)
  {
    ConsistencyOptions options;
    options.duration_s = 20.0;
    options.pixel_noise = 0.5;
    options.readout_s = readout_s;
    options.straighten = straighten;
    double sum = 0.0;
    int count = 0;
    for (uint64_t seed = 1; seed <= 10; ++seed)  // a single run costs 3 to 15 times
    {
      for (const ConsistencySample& sample : runConsistency(consistencyTrajectory(options.duration_s), options, seed))
      {
        sum += sample.position_error_m * sample.position_error_m;
        ++count;
      }
    }
    return std::sqrt(sum / count);
  };
  const double global = positionError(0.0, false);
  const double rolling = positionError(0.04, false);
  const double straightened = positionError(0.04, true);
  std::cout << "position, RMS: " << global << " m with global shutters, " << rolling << " with rolling ones, "
            << straightened << " straightened\n";
  EXPECT_GT(rolling, 5.0 * global);
  EXPECT_LT(straightened, 2.0 * global);  // not equal: what one camera sees is straightened for rotation only
}
