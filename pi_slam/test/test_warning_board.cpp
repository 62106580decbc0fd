#include <gtest/gtest.h>
#include <pi_slam/ros/warning_board.h>
#include <ros/console.h>

#include <string>
#include <vector>

namespace pi_slam
{
namespace
{

/// Counts the lines that reach the log.
class CountingAppender : public ros::console::LogAppender
{
public:
  CountingAppender() { ros::console::register_appender(this); }
  ~CountingAppender() override { ros::console::deregister_appender(this); }
  void log(ros::console::Level level, const char* text, const char*, const char*, int) override
  {
    lines.emplace_back((level == ros::console::levels::Error ? "error: " : "warning: ") + std::string(text));
  }
  std::vector<std::string> lines;
};

TEST(WarningBoard, LogsAWarningOncePerPeriodWhateverItsNumbers)
{
  CountingAppender log;
  WarningBoard board(3600.0);
  for (int i = 0; i < 100; ++i)
  {
    board.warn("/imu/data: nothing for " + std::to_string(0.1 * i) + " s");
  }
  board.error("another");
  EXPECT_EQ((std::vector<std::string>{"warning: /imu/data: nothing for 0.000000 s", "error: another"}), log.lines);
}

TEST(WarningBoard, ShowsTheNewestTextAndErrorsFirst)
{
  WarningBoard board(3600.0);
  board.warn("gap of 0.1 s");
  board.warn("gap of 0.2 s");
  board.error("swapped");
  const auto recent = board.recent();
  ASSERT_EQ(2u, recent.size());
  EXPECT_EQ("swapped", recent[0].text);
  EXPECT_TRUE(recent[0].error);
  EXPECT_EQ("gap of 0.2 s", recent[1].text);
  EXPECT_FALSE(recent[1].error);
}

TEST(WarningBoard, ForgetsAndLogsAgainAfterThePeriod)
{
  CountingAppender log;
  WarningBoard board(1e-9);
  board.warn("dark");
  EXPECT_TRUE(board.recent().empty());
  board.warn("dark");
  EXPECT_EQ(2u, log.lines.size());
}

}  // namespace
}  // namespace pi_slam
