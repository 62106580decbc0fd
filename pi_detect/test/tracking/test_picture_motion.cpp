#include <gtest/gtest.h>
#include <pi_detect/picture_motion.h>

#include <opencv2/imgproc.hpp>

namespace
{

using namespace pi_detect;

constexpr int WIDTH = 640;
constexpr int HEIGHT = 480;

PictureView viewOf(const cv::Mat& picture)
{
  return {picture.data, picture.cols, picture.rows, picture.step,
          picture.channels() == 1 ? PictureView::Format::MONO8 : PictureView::Format::BGR8};
}

/// A blurred random pattern, which has corners everywhere.
cv::Mat texture(int width, int height, int type = CV_8UC1)
{
  cv::Mat picture(height, width, type);
  cv::RNG random(5);
  random.fill(picture, cv::RNG::UNIFORM, 0.0, 255.0);
  cv::GaussianBlur(picture, picture, cv::Size(), 4.0);
  cv::normalize(picture, picture, 0.0, 255.0, cv::NORM_MINMAX);
  return picture;
}

cv::Mat moved(const cv::Mat& picture, const cv::Matx23d& motion)
{
  cv::Mat result;
  cv::warpAffine(picture, result, motion, picture.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  return result;
}

void expectMotion(const PictureMotion& motion, const cv::Matx23d& truth)
{
  ASSERT_TRUE(motion);
  for (const Eigen::Vector2d& point : {Eigen::Vector2d(50.0, 50.0), Eigen::Vector2d(600.0, 400.0)})
  {
    const Eigen::Vector2d result = motion(point);
    EXPECT_NEAR(result.x(), truth(0, 0) * point.x() + truth(0, 1) * point.y() + truth(0, 2), 0.5);
    EXPECT_NEAR(result.y(), truth(1, 0) * point.x() + truth(1, 1) * point.y() + truth(1, 2), 0.5);
  }
}

TEST(PictureMotion, IsThatOfThePicture)
{
  const cv::Matx23d shift(1.0, 0.0, -25.0, 0.0, 1.0, 6.0);
  const cv::Matx23d growth(1.02, 0.0, -6.0, 0.0, 1.02, -5.0);
  for (const cv::Matx23d& truth : {shift, growth})
  {
    for (const int type : {CV_8UC1, CV_8UC3})
    {
      PictureMotionEstimator estimator;
      const cv::Mat picture = texture(WIDTH, HEIGHT, type);
      EXPECT_FALSE(estimator.update(viewOf(picture), {}));
      expectMotion(estimator.update(viewOf(moved(picture, truth)), {}), truth);
    }
  }
}

TEST(PictureMotion, IsNotThatOfThingsThatMove)
{
  // A third of the picture goes to the right; the rest stands still.
  const cv::Rect thing(200, 100, 250, 300);
  const cv::Mat before = texture(WIDTH, HEIGHT);
  cv::Mat now = before.clone();
  before(thing).copyTo(now(thing + cv::Point(20, 0)));
  const std::vector<Box> boxes{{200.0F, 100.0F, 450.0F, 400.0F}};
  for (const bool known : {true, false})
  {
    PictureMotionEstimator estimator;
    estimator.update(viewOf(before), {});
    expectMotion(estimator.update(viewOf(now), known ? boxes : std::vector<Box>()),
                 cv::Matx23d(1.0, 0.0, 0.0, 0.0, 1.0, 0.0));
  }
}

TEST(PictureMotion, IsUnknownWithoutCornersOrAPictureBefore)
{
  PictureMotionEstimator estimator;
  const cv::Mat flat(HEIGHT, WIDTH, CV_8UC1, cv::Scalar::all(90.0));
  EXPECT_FALSE(estimator.update(viewOf(flat), {}));
  EXPECT_FALSE(estimator.update(viewOf(flat), {}));
  const cv::Mat picture = texture(WIDTH, HEIGHT);
  estimator.update(viewOf(picture), {});
  EXPECT_FALSE(estimator.update(viewOf(texture(WIDTH, HEIGHT / 2)), {})) << "another size";
  EXPECT_FALSE(estimator.update(viewOf(picture), {}, false)) << "not wanted";
  EXPECT_TRUE(estimator.update(viewOf(picture), {})) << "but remembered";
  EXPECT_FALSE(estimator.update(viewOf(picture), {{0.0F, 0.0F, 640.0F, 480.0F}})) << "nothing stands still";
  cv::Mat another = texture(2 * WIDTH, HEIGHT);
  EXPECT_FALSE(estimator.update(viewOf(another(cv::Rect(WIDTH, 0, WIDTH, HEIGHT)).clone()), {})) << "a cut";
}

TEST(PictureMotion, BearsTinyPictures)
{
  PictureMotionEstimator estimator;
  const cv::Mat tiny = texture(2, 2);
  EXPECT_FALSE(estimator.update(viewOf(tiny), {}));
  EXPECT_FALSE(estimator.update(viewOf(tiny), {{-5.0F, -5.0F, 1.0F, 9.0F}}));
}

}  // namespace
