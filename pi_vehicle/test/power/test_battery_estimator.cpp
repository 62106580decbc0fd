// How long a battery lasts.

#include "power/battery_estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "test_values.h"

namespace pi_vehicle::power
{
namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

TEST(BatteryEstimator, ThePapersBatteryLastsThePapersFiveHours)
{
  // 2200 mAh at 5 W; with three cells 4.9 h.
  BatteryEstimator estimator{BatteryOptions()};
  EXPECT_NEAR(4.88, estimator.update(SECOND, {11.1, UNKNOWN, 1.0}, 5.0).remaining_s / 3600.0, 0.01);
}

TEST(BatteryEstimator, TheBatterysOwnCurrentCountsBeforeTheComputersDraw)
{
  BatteryEstimator estimator{BatteryOptions()};
  EXPECT_DOUBLE_EQ(5.0, estimator.update(SECOND, {10.0, UNKNOWN, 0.5}, 5.0).draw_w);
  EXPECT_DOUBLE_EQ(40.0, estimator.update(2 * SECOND, {10.0, -4.0, 0.5}, 5.0).draw_w);  // at once: another draw
}

TEST(BatteryEstimator, TheDrawIsSmoothed)
{
  BatteryOptions options;
  options.smoothing_s = 10.0;
  BatteryEstimator estimator(options);
  estimator.update(SECOND, {10.0, -1.0, 0.5}, 0.0);
  const double after_step = estimator.update(2 * SECOND, {10.0, -2.0, 0.5}, 0.0).draw_w;
  EXPECT_NEAR(10.0 + 10.0 * (1.0 - std::exp(-0.1)), after_step, 1e-9);
  EXPECT_NEAR(20.0, estimator.update(200 * SECOND, {10.0, -2.0, 0.5}, 0.0).draw_w, 1e-6);
}

TEST(BatteryEstimator, WithoutChargeOrWhileItIsChargedNothingIsSaid)
{
  BatteryEstimator estimator{BatteryOptions()};
  EXPECT_TRUE(std::isnan(estimator.update(SECOND, {}, UNKNOWN).remaining_s));
  EXPECT_TRUE(std::isnan(estimator.update(2 * SECOND, {}, 5.0).remaining_s));
  EXPECT_TRUE(std::isnan(estimator.update(3 * SECOND, {12.0, 1.0, 0.5}, 5.0).remaining_s));
  EXPECT_LT(estimator.update(4 * SECOND, {12.0, 1.0, 0.5}, 5.0).draw_w, 0.0);
}

TEST(BatteryEstimator, AnEmptyBatteryLastsNoTime)
{
  BatteryEstimator estimator{BatteryOptions()};
  EXPECT_DOUBLE_EQ(0.0, estimator.update(SECOND, {9.0, -1.0, 0.0}, 5.0).remaining_s);
  EXPECT_DOUBLE_EQ(0.0, estimator.update(2 * SECOND, {9.0, -1.0, -0.1}, 5.0).remaining_s);
}

TEST(BatteryEstimator, WrongOptionsAreNamed)
{
  BatteryOptions options;
  options.empty_charge = 0.3;
  try
  {
    BatteryEstimator{options};
    FAIL() << "accepted";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ("battery/empty_charge = 0.3, must be in [0, 0.2]", error.what());
  }
}

}  // namespace
}  // namespace pi_vehicle::power
