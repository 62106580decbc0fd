// Judge of runtime_streams.test.

#include "drive_on_graph.h"

#include <gtest/gtest.h>
#include <pi_runtime/ListStreams.h>

#include <map>
#include <set>
#include <string>

namespace pi_slam
{
namespace
{

constexpr double DRIVE_S = 8.0;  // jobs are counted from a stage's ninth run on
constexpr double TIMEOUT_S = 20.0;

using Streams = std::map<std::string, pi_runtime::Stream>;

/// Those of this graph: all processes of a computer share its units, also those of other tests.
Streams streams(bool together)
{
  const std::string manager = "/manager";
  const std::set<pid_t> own = {pi_node::test_support::processOf(together ? manager : "/vio"),
                               pi_node::test_support::processOf(together ? manager : "/ssd")};
  Streams found;
  pi_runtime::ListStreams list;
  if (ros::service::call("/runtime/list_streams", list))
  {
    for (const pi_runtime::Stream& stream : list.response.streams)
    {
      if (own.count(stream.pid) != 0)
      {
        found[stream.name] = stream;
      }
    }
  }
  return found;
}

TEST(RuntimeStreams, OfAllServicesAreListedDuringADrive)
{
  const bool together = ros::param::param("~together", false);
  ASSERT_TRUE(ros::service::waitForService("/runtime/list_streams", ros::Duration(TIMEOUT_S)));
  DriveOnGraph drive(SyntheticDrive::make(DRIVE_S));
  ASSERT_TRUE(drive.waitForListeners(TIMEOUT_S));
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return streams(together).count("detection") != 0; }))
      << "the network is not loaded";
  drive.play(0.0, DRIVE_S, 1.0);
  const auto have_run = [&]
  {
    Streams now = streams(together);
    return now["slam_front_end"].jobs >= 40 && now["slam_window"].jobs > 0 && now["slam_map"].jobs > 0 &&
           now["detection"].jobs > 0;
  };
  EXPECT_TRUE(until(TIMEOUT_S, have_run));
  Streams now = streams(together);
  for (const char* const name : {"slam_front_end", "slam_window", "slam_map", "detection"})
  {
    const pi_runtime::Stream& stream = now[name];
    EXPECT_GT(stream.jobs, 0u) << name;
    EXPECT_EQ(together, stream.id != 0) << name << ": only streams of the same process have an id";
    EXPECT_GT(stream.pid, 0) << name;
    EXPECT_GT(stream.p99_s, 0.0) << name;
    EXPECT_GE(stream.max_s, stream.p50_s) << name;
  }
  EXPECT_EQ(together, now["slam_front_end"].pid == now["detection"].pid);
  const pi_runtime::Stream& front_end = now["slam_front_end"];
  EXPECT_NE("", front_end.unit) << "has no reserved capacity";
  EXPECT_GT(front_end.wcet_s, 0.0);
  // A computer under load leaves pairs out: its period is longer than that of the cameras.
  EXPECT_GT(front_end.period_s, 1.0 / 15.0 - 0.02);
  EXPECT_EQ(front_end.period_s, front_end.deadline_s) << "one frame";
}

}  // namespace
}  // namespace pi_slam

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "runtime_streams_test");
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
