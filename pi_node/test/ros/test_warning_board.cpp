#include <gtest/gtest.h>
#include <pi_node/ros/warning_board.h>

#include <string>
#include <vector>

namespace pi_node
{
namespace
{

/// Keeps what a board logs.
struct Lines
{
  std::vector<std::string> lines;
  WarningBoard::Log log = [this](bool error, const std::string& text)
  { lines.push_back((error ? "error: " : "warning: ") + text); };
};

TEST(WarningBoard, LogsAWarningOncePerPeriodWhateverItsNumbers)
{
  Lines written;
  WarningBoard board(3600.0, written.log);
  for (int i = 0; i < 100; ++i)
  {
    board.warn("/imu/data: nothing for " + std::to_string(0.1 * i) + " s");
  }
  board.error("another");
  EXPECT_EQ((std::vector<std::string>{"warning: /imu/data: nothing for 0.000000 s", "error: another"}), written.lines);
}

TEST(WarningBoard, ShowsTheNewestTextAndErrorsFirst)
{
  Lines written;
  WarningBoard board(3600.0, written.log);
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
  Lines written;
  WarningBoard board(1e-9, written.log);
  board.warn("dark");
  EXPECT_TRUE(board.recent().empty());
  board.warn("dark");
  EXPECT_EQ(2u, written.lines.size());
}

}  // namespace
}  // namespace pi_node
