#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_slam/trajectory_file.h>

using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

TEST(TrajectoryFile, ReadsTumLinesToTheNanosecond)
{
  const TemporaryFolder folder;
  const auto poses = readTrajectory(folder.file("a.txt",
                                                "# t x y z qx qy qz qw\n"
                                                "1403636580.838555649 1 2 3 0 0 0.6 0.8 99 98\n\n"
                                                "1403636581 4 5 6 0 0 0 1\r\n"));
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].stamp_ns, 1403636580838555649LL);
  EXPECT_EQ(poses[1].stamp_ns, 1403636581000000000LL);
  EXPECT_EQ(poses[0].T_world_body.translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_LT((poses[0].T_world_body.linear() - Eigen::Quaterniond(0.8, 0, 0, 0.6).toRotationMatrix()).norm(), 1e-12);
}

TEST(TrajectoryFile, ReadsEurocGroundTruth)
{
  const TemporaryFolder folder;
  const auto poses = readTrajectory(folder.file("data.csv",
                                                "#timestamp, p, q, v\n"
                                                "1403636580838555648,1,2,3,0.8,0,0,0.6,0,0,0\n"
                                                "1403636580843555648,1,2,3,0.8,0,0,0.6,0,0,0\n"));
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].stamp_ns, 1403636580838555648LL);
  EXPECT_LT((poses[0].T_world_body.linear() - Eigen::Quaterniond(0.8, 0, 0, 0.6).toRotationMatrix()).norm(), 1e-12);
}

TEST(TrajectoryFile, NamesFileLineAndDefect)
{
  const TemporaryFolder folder;
  const std::string good = "1.0 0 0 0 0 0 0 1\n";
  const auto complaint = [&](const std::string& text)
  { return messageOf<RecordingError>([&] { readTrajectory(folder.file("a.txt", text)); }); };
  EXPECT_NE(complaint(good + "2.0 0 0 0\n").find("a.txt:2: has 4 columns"), std::string::npos);
  EXPECT_NE(complaint(good + "2.0 0 x 0 0 0 0 1\n").find("a.txt:2: column 3 is \"x\""), std::string::npos);
  EXPECT_NE(complaint(good + "2.0 0 nan 0 0 0 0 1\n").find("a.txt:2: column 3"), std::string::npos);
  EXPECT_NE(complaint(good + good).find("a.txt:2: time stamp is not after"), std::string::npos);
  EXPECT_NE(complaint(good + "2.0 0 0 0 0 0 0 2\n").find("norm 2.0"), std::string::npos);
  EXPECT_NE(complaint("today 0 0 0 0 0 0 1\n").find("\"today\" is no time stamp"), std::string::npos);
  EXPECT_NE(complaint(good).find("has 1 poses"), std::string::npos);
  EXPECT_NE(messageOf<RecordingError>([] { readTrajectory("/nowhere.txt"); }).find("missing"), std::string::npos);
}

TEST(Seconds, FormatAndParseUndoEachOther)
{
  for (const int64_t stamp_ns : {0LL, 5LL, 999999999LL, 1700000000000000001LL})
  {
    int64_t parsed = -1;
    ASSERT_TRUE(parseSeconds(formatSeconds(stamp_ns), &parsed));
    EXPECT_EQ(parsed, stamp_ns);
  }
  int64_t untouched = 7;
  EXPECT_FALSE(parseSeconds("-1.0", &untouched));
  EXPECT_FALSE(parseSeconds("1.5e9", &untouched));
  EXPECT_EQ(untouched, 7);
}
