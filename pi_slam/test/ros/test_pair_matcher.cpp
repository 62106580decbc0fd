#include <gtest/gtest.h>
#include "front_end/frame_features.h"
#include "ros/pair_matcher.h"

#include <vector>

namespace pi_slam
{
namespace
{

constexpr int64_t MS = 1000000;
const cv::Mat PICTURE = cv::Mat::zeros(2, 2, CV_8UC1);

/// Tolerance 2 ms, wait 100 ms.
class PairMatcherTest : public testing::Test
{
protected:
  void add(int camera, int64_t stamp_ms) { matcher.add(camera, stamp_ms * MS, PICTURE, &pairs); }
  /// "L", "R" or "LR" and the stamp [ms] of each pair so far.
  std::string text() const
  {
    std::string result;
    for (const PicturePair& pair : pairs)
    {
      result += (result.empty() ? "" : " ") + std::string(pair.left.empty() ? "" : "L") +
                (pair.right.empty() ? "" : "R") + std::to_string(pair.stamp_ns / MS);
    }
    return result;
  }

  PairMatcher matcher{0.002, 0.1};
  std::vector<PicturePair> pairs;
};

TEST_F(PairMatcherTest, PairsPicturesOfTheSameTime)
{
  add(LEFT, 100);
  EXPECT_EQ("", text());
  add(RIGHT, 100);
  add(RIGHT, 150);
  add(LEFT, 150);
  EXPECT_EQ("LR100 LR150", text());
  EXPECT_EQ(0u, matcher.single());
}

TEST_F(PairMatcherTest, PairsWithinTheToleranceAtTheStampOfTheLeft)
{
  add(RIGHT, 102);
  add(LEFT, 100);
  EXPECT_EQ("LR100", text());
  EXPECT_FALSE(matcher.takeMismatch());
}

TEST_F(PairMatcherTest, SideThatIsLateIsWaitedFor)
{
  add(LEFT, 100);
  add(LEFT, 150);
  add(RIGHT, 100);
  EXPECT_EQ("LR100", text());
  add(RIGHT, 150);
  EXPECT_EQ("LR100 LR150", text());
}

TEST_F(PairMatcherTest, PictureWhosePartnerCannotComeGoesOnAlone)
{
  add(LEFT, 100);
  add(RIGHT, 150);  // newer, so the one of 100 was lost
  add(LEFT, 150);
  EXPECT_EQ("L100 LR150", text());
  EXPECT_EQ(1u, matcher.single());
  EXPECT_FALSE(matcher.takeMismatch());  // 50 ms apart are two different pairs
}

TEST_F(PairMatcherTest, CameraAloneGoesOnAfterTheWait)
{
  add(LEFT, 100);
  add(LEFT, 150);
  EXPECT_EQ("", text());
  add(LEFT, 200);
  EXPECT_EQ("L100", text());
  add(LEFT, 250);
  EXPECT_EQ("L100 L150", text());
}

TEST_F(PairMatcherTest, PictureThatCameTooLateIsCounted)
{
  add(RIGHT, 100);
  add(RIGHT, 200);
  ASSERT_EQ("R100", text());
  add(LEFT, 100);
  add(RIGHT, 200);  // twice
  EXPECT_EQ("R100", text());
  EXPECT_EQ(2u, matcher.late());
}

TEST_F(PairMatcherTest, CamerasThatAreNotTriggeredTogetherAreTold)
{
  add(LEFT, 100);
  add(RIGHT, 110);
  const auto mismatch_s = matcher.takeMismatch();
  ASSERT_TRUE(mismatch_s);
  EXPECT_NEAR(0.010, *mismatch_s, 1e-9);
  EXPECT_FALSE(matcher.takeMismatch());
}

TEST_F(PairMatcherTest, PicturesThatWereLostAreNoCamerasThatAreNotTriggeredTogether)
{
  add(LEFT, 100);
  add(RIGHT, 100);
  add(LEFT, 117);  // 60 Hz
  add(RIGHT, 134);
  add(RIGHT, 151);
  add(LEFT, 151);
  EXPECT_EQ("LR100 L117 R134 LR151", text());
  EXPECT_FALSE(matcher.takeMismatch());
  add(LEFT, 168);
  add(RIGHT, 176);
  EXPECT_TRUE(matcher.takeMismatch()) << "half a frame apart";
}

TEST_F(PairMatcherTest, StampsThatHardlyAdvanceDoNotPileUp)
{
  for (int64_t i = 0; i < 1000; ++i)
  {
    matcher.add(LEFT, 100 * MS + i, PICTURE, &pairs);
  }
  EXPECT_GT(pairs.size(), 900u);
}

TEST_F(PairMatcherTest, ForgetsAllOfTheOldTime)
{
  add(LEFT, 1000);
  matcher.clear();
  add(LEFT, 100);
  add(RIGHT, 100);
  EXPECT_EQ("LR100", text());
}

}  // namespace
}  // namespace pi_slam
