#include <gtest/gtest.h>
#include <pi_node/vehicle_clock.h>
#include "ros/vio_pipeline.h"

namespace pi_slam
{
namespace
{

double budgetOfPipeline()
{
  VioRosOptions options;
  options.mapping = false;
  options.vio.frame_budget_s = 0.01;
  FileCalibration calibration;
  calibration.cameras = StereoCalibration::makeForwardPair(320, 240, 0.12);
  return VioPipeline::make(options, nullptr, calibration, Eigen::Isometry3d::Identity())->vio_options.frame_budget_s;
}

/// A simulator waits for the pairs: a busy computer must not change the estimate.
TEST(VioPipeline, HasABudgetOfTimeOnAVehicleOnly)
{
  EXPECT_EQ(budgetOfPipeline(), 0.01);
  pi_node::simulateTime([]() -> int64_t { return 0; });
  const double simulated = budgetOfPipeline();
  pi_node::simulateTime(nullptr);
  EXPECT_EQ(simulated, 0.0);
}

TEST(VioPipeline, KeepsWhatWasFoundOfTheCalibrationWhenItBeginsAgain)
{
  VioRosOptions options;
  options.mapping = false;
  FileCalibration calibration;
  calibration.cameras = StereoCalibration::makeForwardPair(320, 240, 0.12);
  VioPipeline before = *VioPipeline::make(options, nullptr, calibration, Eigen::Isometry3d::Identity());
  EXPECT_EQ(before.vio->rig().used.late_s, 0.0);
  RigReport found;
  found.late_s = found.used.late_s = 0.008;
  found.covariance(3, 3) = 1e-6;
  before.vio = std::make_shared<Vio>(calibration.cameras, options.vio, nullptr, found);
  const RigReport kept = before.again(options, nullptr, true)->vio->rig();
  EXPECT_EQ(kept.used.late_s, 0.008);
  EXPECT_EQ(kept.lateDeviation(), 1e-3);
}

}  // namespace
}  // namespace pi_slam
