#include "vehicle/fault_schedule.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace pi_simulation
{
namespace
{

using Lines = std::vector<std::string>;

/// The lines that are due; those that restore behind a +.
Lines due(FaultSchedule* schedule, double time, double x)
{
  Lines lines;
  for (const DueCommand& command : schedule->due(time, {x, 0.0}))
  {
    lines.push_back((command.restores ? "+" : "") + command.line);
  }
  return lines;
}

PlannedFault fault(double time, double duration, const std::string& begin, const std::string& end)
{
  PlannedFault result;
  result.time = time;
  result.duration = duration;
  result.begin = begin;
  result.end = end;
  return result;
}

TEST(FaultSchedule, BeginsAtItsTimeAndEndsAfterItsDuration)
{
  FaultSchedule schedule({fault(2.0, 3.0, "imu off", "imu on")});
  EXPECT_EQ(Lines{}, due(&schedule, 1.9, 0.0));
  EXPECT_EQ(Lines{"imu off"}, due(&schedule, 2.0, 0.0));
  EXPECT_EQ(Lines{}, due(&schedule, 4.9, 0.0));
  EXPECT_EQ(Lines{"+imu on"}, due(&schedule, 5.0, 0.0));
  EXPECT_EQ(Lines{}, due(&schedule, 60.0, 0.0));
}

TEST(FaultSchedule, EndsWhenTheVehicleLeavesThePlaceAndDoesNotBeginAgain)
{
  PlannedFault area = fault(0.0, 0.0, "radio off", "radio on");
  area.near = Eigen::Vector2d(10.0, 0.0);
  area.within = 2.0;
  FaultSchedule schedule({area});
  EXPECT_EQ(Lines{}, due(&schedule, 1.0, 7.9));
  EXPECT_EQ(Lines{"radio off"}, due(&schedule, 2.0, 8.1));
  EXPECT_EQ(Lines{}, due(&schedule, 3.0, 11.9));
  EXPECT_EQ(Lines{"+radio on"}, due(&schedule, 4.0, 12.1));
  EXPECT_EQ(Lines{}, due(&schedule, 5.0, 10.0));
}

TEST(FaultSchedule, WithTimeAndPlaceBothMustHold)
{
  PlannedFault both = fault(5.0, 0.0, "kill vio", "");
  both.near = Eigen::Vector2d(10.0, 0.0);
  both.within = 2.0;
  FaultSchedule schedule({both});
  EXPECT_EQ(Lines{}, due(&schedule, 4.0, 10.0));
  EXPECT_EQ(Lines{}, due(&schedule, 6.0, 20.0));
  EXPECT_EQ(Lines{"kill vio"}, due(&schedule, 7.0, 10.0));
  EXPECT_EQ(Lines{}, due(&schedule, 8.0, 20.0));  // for good
}

}  // namespace
}  // namespace pi_simulation
