#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <opencv2/features2d.hpp>
#include <set>

#include "codelet_runner.h"
#include "kernel_test_images.h"
#include <pi_runtime/kernels/gaussian_blur.h>
#include <pi_runtime/kernels/orb.h>

namespace pi_runtime
{
namespace kernels
{
namespace
{

cv::Mat smooth(const cv::Mat& image)
{
  cv::Mat result;
  cv::GaussianBlur(image, result, cv::Size(7, 7), 2, 2);
  return result;
}

struct Features
{
  cv::Mat descriptors;
  std::vector<uint16_t> angles;
};

Features describe(const cv::Mat& image, const std::vector<cv::Point2f>& points)
{
  const cv::Mat smoothed = smooth(image);
  Features features{cv::Mat(static_cast<int>(points.size()), ORB_BYTES, CV_8U), std::vector<uint16_t>(points.size())};
  describeOrb({image.data, image.cols, image.rows, image.step[0]},
              {smoothed.data, smoothed.cols, smoothed.rows, smoothed.step[0]}, &points[0].x, orbTables(), 0,
              points.size(), features.descriptors.data, features.angles.data());
  return features;
}

std::vector<cv::Point2f> cornersOf(const cv::Mat& image, int count, int border)
{
  cv::Mat mask(image.size(), CV_8U, cv::Scalar(0));
  mask(cv::Rect(border, border, image.cols - 2 * border, image.rows - 2 * border)) = 255;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(image, corners, count, 0.0003, 5, mask);
  return corners;
}

TEST(OrbTables, TestsLieInTheDiscAndDifferFromEachOther)
{
  const OrbTables& tables = orbTables();
  std::set<std::array<int, 4>> seen;
  for (int i = 0; i < 2 * ORB_BITS; ++i)
  {
    EXPECT_LE(tables.x[i] * tables.x[i] + tables.y[i] * tables.y[i], ORB_TEST_RADIUS * ORB_TEST_RADIUS);
  }
  for (int i = 0; i < ORB_BITS; ++i)
  {
    const int j = i + ORB_BITS;
    seen.insert({tables.x[i], tables.y[i], tables.x[j], tables.y[j]});
  }
  EXPECT_EQ(seen.size(), static_cast<size_t>(ORB_BITS));
}

TEST(OrbTables, TurnedTestsStayWithinTheBorder)
{
  const OrbTables& tables = orbTables();
  for (int angle = 0; angle < ORB_ANGLES; ++angle)
  {
    const int c = tables.cosine[angle];
    const int s = tables.sine[angle];
    for (int i = 0; i < 2 * ORB_BITS; ++i)
    {
      ASSERT_LT(std::abs((tables.x[i] * c - tables.y[i] * s + 8192) >> 14), ORB_BORDER);
      ASSERT_LT(std::abs((tables.x[i] * s + tables.y[i] * c + 8192) >> 14), ORB_BORDER);
    }
  }
}

/// Pictures of the same scene, points of the first one and where the second has them.
struct Pair
{
  cv::Mat first;
  cv::Mat second;
  std::vector<cv::Point2f> first_points;
  std::vector<cv::Point2f> second_points;
};

Pair warped(double degrees, double scale, double noise)
{
  Pair pair;
  pair.first = pictureWithCorners(640, 480, 3);
  const cv::Mat turn = cv::getRotationMatrix2D({320, 240}, degrees, scale);
  cv::warpAffine(pair.first, pair.second, turn, pair.first.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  cv::Mat grain(pair.second.size(), CV_16S);
  cv::RNG(9).fill(grain, cv::RNG::NORMAL, 0, noise);
  cv::add(pair.second, grain, pair.second, cv::noArray(), CV_8U);
  for (const cv::Point2f& corner : cornersOf(pair.first, 1500, 32))
  {
    std::vector<cv::Point2f> moved;
    cv::transform(std::vector<cv::Point2f>{corner}, moved, turn);
    if (cv::Rect2f(32, 32, 640 - 64, 480 - 64).contains(moved[0]))
    {
      pair.first_points.push_back(corner);
      pair.second_points.push_back(moved[0]);
    }
  }
  return pair;
}

double correctRate(const cv::Mat& first, const cv::Mat& second)
{
  std::vector<cv::DMatch> matches;
  cv::BFMatcher(cv::NORM_HAMMING).match(first, second, matches);
  const auto correct = std::count_if(matches.begin(), matches.end(),
                                     [](const cv::DMatch& match) { return match.queryIdx == match.trainIdx; });
  return static_cast<double>(correct) / first.rows;
}

/// OpenCV's descriptors at the same points, with our orientations: compute() leaves those to the detector.
cv::Mat openCvs(const cv::Mat& image, const std::vector<cv::Point2f>& points, const std::vector<uint16_t>& angles)
{
  std::vector<cv::KeyPoint> keypoints;
  for (size_t i = 0; i < points.size(); ++i)
  {
    keypoints.emplace_back(points[i], 31.0F, 360.0F * angles[i] / ORB_ANGLES, 1.0F, 0);
  }
  cv::Mat descriptors;
  cv::ORB::create(500, 1.2F, 1)->compute(image, keypoints, descriptors);
  return descriptors;
}

TEST(Orb, MatchesTurnedAndNoisyPicturesAsWellAsOpenCvsLearnedPattern)
{
  double ours = 0.0;
  double theirs = 0.0;
  const std::vector<std::pair<double, double>> warps{{0.0, 1.0}, {17.0, 1.0}, {45.0, 1.1}, {90.0, 0.9}, {171.0, 1.2}};
  for (const auto& [degrees, scale] : warps)
  {
    for (const double noise : {0.0, 8.0, 16.0})
    {
      const Pair pair = warped(degrees, scale, noise);
      ASSERT_GT(pair.first_points.size(), 300U);
      const Features first = describe(pair.first, pair.first_points);
      const Features second = describe(pair.second, pair.second_points);
      const double rate = correctRate(first.descriptors, second.descriptors);
      const double reference = correctRate(openCvs(pair.first, pair.first_points, first.angles),
                                           openCvs(pair.second, pair.second_points, second.angles));
      ours += rate / 15;
      theirs += reference / 15;
    }
  }
  RecordProperty("ours", std::to_string(ours));
  RecordProperty("opencv", std::to_string(theirs));
  EXPECT_GT(ours, theirs);
  EXPECT_GT(ours, 0.8);
}

TEST(Orb, OrientationFollowsTheIntensityCentroid)
{
  const cv::Mat image = pictureWithCorners(320, 240, 5);
  const std::vector<cv::Point2f> points = cornersOf(image, 200, 32);
  const Features features = describe(image, points);
  for (size_t i = 0; i < points.size(); ++i)
  {
    double m10 = 0.0;
    double m01 = 0.0;
    for (int y = -15; y <= 15; ++y)
    {
      for (int x = -15; x <= 15; ++x)
      {
        if (x * x + y * y <= 225)
        {
          const double level = image.at<uint8_t>(cvRound(points[i].y) + y, cvRound(points[i].x) + x);
          m10 += x * level;
          m01 += y * level;
        }
      }
    }
    const double expected = std::atan2(m01, m10) * ORB_ANGLES / (2.0 * CV_PI);
    // Half a step of rounding, and the tangents' rounding to 2^-14.
    EXPECT_LT(std::abs(std::remainder(features.angles[i] - expected, ORB_ANGLES)), 0.505) << "point " << i;
  }
}

TEST(Orb, OrientationHasAllDirections)
{
  for (int angle = 0; angle < ORB_ANGLES; ++angle)
  {
    cv::Mat image(64, 64, CV_8U, cv::Scalar(100));
    const double direction = 2.0 * CV_PI * angle / ORB_ANGLES;
    for (int y = 0; y < 64; ++y)
    {
      for (int x = 0; x < 64; ++x)
      {
        const double along = (x - 32) * std::cos(direction) + (y - 32) * std::sin(direction);
        image.at<uint8_t>(y, x) = cv::saturate_cast<uint8_t>(128.0 + 4.0 * along);
      }
    }
    const int found = describe(image, {{32.0F, 32.0F}}).angles[0];
    EXPECT_LE(std::abs(std::remainder(found - angle, ORB_ANGLES)), 1.0) << "direction " << angle;
  }
}

class OrbCodelet : public testing::Test
{
protected:
  struct Job
  {
    std::vector<Argument> arguments;
    BufferPtr descriptors;
    BufferPtr angles;
    uint64_t points;
  };

  static Job job(const cv::Mat& image, const cv::Mat& smoothed, const std::vector<cv::Point2f>& points)
  {
    Job job;
    job.points = points.size();
    job.descriptors = Buffer::allocate(points.size() * ORB_BYTES);
    job.angles = Buffer::allocate(points.size() * sizeof(uint16_t));
    const OrbShape shape{image.cols, image.rows, static_cast<int>(image.step[0]), static_cast<int>(smoothed.step[0]),
                         static_cast<int>(points.size())};
    job.arguments = {
        Argument::in(wrapMat(image)),    Argument::in(wrapMat(smoothed)), Argument::in(wrapMat(cv::Mat(points, true))),
        Argument::in(orbTablesBuffer()), Argument::out(job.descriptors),  Argument::out(job.angles),
        Argument::value(shape)};
    return job;
  }

  static void expectEqual(const Job& a, const Job& b)
  {
    const auto same = [](const BufferPtr& s, const BufferPtr& t)
    { return std::memcmp(s->host(Access::READ), t->host(Access::READ), s->bytes()) == 0; };
    EXPECT_TRUE(same(a.angles, b.angles));
    EXPECT_TRUE(same(a.descriptors, b.descriptors));
  }

  static std::vector<cv::Point2f> scatter(const cv::Mat& image, int count)
  {
    cv::RNG random(4);
    std::vector<cv::Point2f> points;
    for (int i = 0; i < count; ++i)
    {
      points.emplace_back(random.uniform(-2.0F, image.cols + 2.0F), random.uniform(-2.0F, image.rows + 2.0F));
    }
    return points;
  }
};

TEST_F(OrbCodelet, NativeAndOpenClGiveTheSameBits)
{
  for (const Content content : {Content::NATURAL, Content::RANDOM, Content::CONSTANT, Content::GRADIENT})
  {
    const cv::Mat image = withGaps(makeImage(content, 639, 479), 13);
    const cv::Mat smoothed = smooth(image);
    const std::vector<cv::Point2f> points = scatter(image, 501);
    const Job native = job(image, smoothed, points);
    const Job opencl = job(image, smoothed, points);
    CodeletRunner::shared().native(orbCodelet(), native.arguments, native.points);
    CodeletRunner::shared().opencl(orbCodelet(), opencl.arguments, opencl.points);
    expectEqual(native, opencl);
  }
}

TEST_F(OrbCodelet, MarksPointsNearTheBorderAndNonsense)
{
  const cv::Mat image = makePicture(100, 80, 1);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float huge = std::numeric_limits<float>::infinity();
  const std::vector<cv::Point2f> points{{19, 19}, {18.4F, 40}, {50, 18.4F}, {80, 60},   {81, 60},
                                        {80, 61}, {nan, 40},   {40, nan},   {huge, 40}, {-1e30F, 40}};
  const std::vector<bool> inside{true, false, false, true, false, false, false, false, false, false};
  const Job native = job(image, image, points);
  const Job opencl = job(image, image, points);
  CodeletRunner::shared().native(orbCodelet(), native.arguments, native.points);
  CodeletRunner::shared().opencl(orbCodelet(), opencl.arguments, opencl.points);
  expectEqual(native, opencl);
  for (size_t i = 0; i < points.size(); ++i)
  {
    const uint8_t* descriptor = native.descriptors->hostAs<const uint8_t>(Access::READ) + i * ORB_BYTES;
    EXPECT_EQ(native.angles->hostAs<const uint16_t>(Access::READ)[i] != ORB_NO_ANGLE, inside[i]) << points[i];
    EXPECT_EQ(std::any_of(descriptor, descriptor + ORB_BYTES, [](uint8_t byte) { return byte != 0; }), inside[i]);
  }
}

TEST_F(OrbCodelet, InSlicesEqualsTheWhole)
{
  const cv::Mat image = pictureWithCorners(320, 240, 2);
  const cv::Mat smoothed = smooth(image);
  const std::vector<cv::Point2f> points = scatter(image, 100);
  const Job whole = job(image, smoothed, points);
  const Job native = job(image, smoothed, points);
  const Job opencl = job(image, smoothed, points);
  CodeletRunner::shared().native(orbCodelet(), whole.arguments, 100);
  CodeletRunner::shared().nativeSliced(orbCodelet(), native.arguments, 100, 7);
  CodeletRunner::shared().openclSliced(orbCodelet(), opencl.arguments, 100, 33);
  expectEqual(whole, native);
  expectEqual(whole, opencl);
}

TEST_F(OrbCodelet, RefusesBuffersThatAreTooSmall)
{
  const cv::Mat image = makePicture(64, 64, 1);
  const std::vector<cv::Point2f> points(10, {32, 32});
  for (size_t index = 0; index < 6; ++index)
  {
    std::vector<Argument> arguments = job(image, image, points).arguments;
    arguments[index] = Argument::out(Buffer::allocate(arguments[index].buffer()->bytes() - 1));
    EXPECT_THROW(CodeletRunner::shared().native(orbCodelet(), arguments, 10), std::runtime_error)
        << "argument " << index;
    EXPECT_THROW(CodeletRunner::shared().opencl(orbCodelet(), arguments, 10), std::runtime_error)
        << "argument " << index;
  }
  EXPECT_THROW(CodeletRunner::shared().native(orbCodelet(), job(image, image, points).arguments, 11),
               std::runtime_error);
}

}  // namespace
}  // namespace kernels
}  // namespace pi_runtime
