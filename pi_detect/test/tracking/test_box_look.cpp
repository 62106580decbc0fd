#include "tracking/box_look.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core/mat.hpp>

namespace
{

using namespace pi_detect;

const cv::Scalar RED(0.0, 0.0, 200.0);
const cv::Scalar BLUE(200.0, 0.0, 0.0);

PictureView viewOf(const cv::Mat& picture)
{
  return {picture.data, picture.cols, picture.rows, picture.step,
          picture.channels() == 1 ? PictureView::Format::MONO8 : PictureView::Format::BGR8};
}

/// 100 x 100 px, with one colour above and one below.
BoxLook lookOf(const cv::Scalar& above, const cv::Scalar& below, int type = CV_8UC3)
{
  cv::Mat picture(100, 100, type, above);
  picture.rowRange(50, 100) = below;
  return BoxLook(viewOf(picture), {20.0F, 0.0F, 80.0F, 100.0F});
}

TEST(BoxLook, IsLikeItselfAndUnlikeOtherColours)
{
  EXPECT_NEAR(lookOf(RED, BLUE).similarity(lookOf(RED, BLUE)), 1.0, 1e-5);
  EXPECT_NEAR(lookOf(RED, RED).similarity(lookOf(BLUE, BLUE)), 0.0, 1e-5);
  EXPECT_NEAR(lookOf(RED, BLUE).similarity(lookOf(RED, RED)), 0.5, 1e-5);
  EXPECT_NEAR(lookOf(RED, BLUE).similarity(lookOf(BLUE, RED)), 0.0, 1e-5) << "above is not below";
}

TEST(BoxLook, TellsGreyLevelsApart)
{
  const auto grey = [](double above, double below)
  { return lookOf(cv::Scalar::all(above), cv::Scalar::all(below), CV_8UC1); };
  EXPECT_NEAR(grey(40.0, 200.0).similarity(grey(40.0, 200.0)), 1.0, 1e-5);
  EXPECT_NEAR(grey(40.0, 200.0).similarity(grey(40.0, 100.0)), 0.5, 1e-5);
}

TEST(BoxLook, DecidesNothingWhereNothingIsKnown)
{
  const BoxLook red = lookOf(RED, RED);
  EXPECT_EQ(red.similarity(BoxLook()), 1.0);
  EXPECT_EQ(BoxLook().similarity(red), 1.0);
  EXPECT_EQ(red.similarity(lookOf(cv::Scalar::all(9.0), cv::Scalar::all(9.0), CV_8UC1)), 1.0) << "grey and colour";
  const cv::Mat picture(100, 100, CV_8UC3, BLUE);
  EXPECT_EQ(red.similarity(BoxLook(viewOf(picture), {120.0F, 0.0F, 180.0F, 50.0F})), 1.0) << "outside";
}

TEST(BoxLook, CountsWhatIsInThePictureOnly)
{
  const cv::Mat picture(100, 100, CV_8UC3, BLUE);
  const BoxLook cut(viewOf(picture), {60.0F, -40.0F, 140.0F, 160.0F});
  EXPECT_GT(cut.similarity(lookOf(BLUE, BLUE)), 0.99);
}

TEST(BoxLook, ChangesSlowly)
{
  BoxLook look = lookOf(RED, RED);
  look.blend(lookOf(BLUE, BLUE), 0.1F);
  EXPECT_NEAR(look.similarity(lookOf(RED, RED)), std::sqrt(0.9), 1e-5);
  look.blend(BoxLook(), 0.1F);
  EXPECT_NEAR(look.similarity(lookOf(RED, RED)), std::sqrt(0.9), 1e-5) << "nothing was seen";
  BoxLook unknown;
  unknown.blend(lookOf(BLUE, BLUE), 0.1F);
  EXPECT_NEAR(unknown.similarity(lookOf(BLUE, BLUE)), 1.0, 1e-5) << "the first look counts whole";
}

}  // namespace
