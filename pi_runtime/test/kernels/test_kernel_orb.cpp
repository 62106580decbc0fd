#include <gtest/gtest.h>
#include <pi_runtime/kernels/orb.h>

#include <array>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <random>
#include <set>
#include <tuple>
#include <vector>

#include "kernels/kernel_test_images.h"

namespace pi_runtime::kernels
{
namespace
{

// The search that made the pattern.

constexpr int CANDIDATES = 2000;
constexpr int64_t ONE = 1 << 14;          ///< correlation 1
constexpr int64_t CORRELATION_AREA = 49;  ///< [px^2]: correlation is a half at 7 px
constexpr int SHORTEST = 6;               ///< of the two pixels of a test [px]
constexpr int FIRST_BOUND = 50;           ///< of correlations [percent]
constexpr int ORB_RADIUS = 15;            ///< of the disc that gives the orientation [px]
constexpr int LONGEST = 2 * ORB_TEST_RADIUS;

struct Pixel
{
  int x;
  int y;
};

struct PixelTest
{
  Pixel a;
  Pixel b;
  int64_t variance;  ///< of the difference, in units of ONE
};

int squaredDistance(Pixel a, Pixel b)
{
  return (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y);
}

/// Covariance of two pixels of the model, in units of ONE.
int64_t covariance(Pixel a, Pixel b)
{
  static const std::vector<int64_t> by_square = []
  {
    std::vector<int64_t> table(LONGEST * LONGEST + 1);
    for (int64_t square = 0; square < static_cast<int64_t>(table.size()); ++square)
    {
      table[square] = ONE * CORRELATION_AREA / (CORRELATION_AREA + square);
    }
    return table;
  }();
  return by_square[squaredDistance(a, b)];
}

int64_t covariance(const PixelTest& s, const PixelTest& t)
{
  return covariance(s.a, t.a) - covariance(s.a, t.b) - covariance(s.b, t.a) + covariance(s.b, t.b);
}

bool inDisc(Pixel p, int radius)
{
  return p.x * p.x + p.y * p.y <= radius * radius;
}

/// The moment m10 = sum of x times grey level over the disc.
class Moment
{
public:
  Moment()
  {
    for (int y = -ORB_RADIUS; y <= ORB_RADIUS; ++y)
    {
      for (int x = -ORB_RADIUS; x <= ORB_RADIUS; ++x)
      {
        if (inDisc({x, y}, ORB_RADIUS))
        {
          disc_.push_back({x, y});
        }
      }
    }
    for (const Pixel& p : disc_)
    {
      variance_ += static_cast<double>(p.x * with(p));
    }
  }
  /// Covariance with one pixel.
  int64_t with(Pixel p) const
  {
    int64_t sum = 0;
    for (const Pixel& q : disc_)
    {
      sum += q.x * covariance(p, q);
    }
    return sum;
  }
  /// Its correlation with a test of pixels a and b, without sign.
  int64_t percent(Pixel a, Pixel b, int64_t variance) const
  {
    const double covariance = static_cast<double>(with(a) - with(b));
    return std::lrint(100.0 * std::abs(covariance) / std::sqrt(static_cast<double>(variance) * variance_));
  }

private:
  std::vector<Pixel> disc_;
  double variance_ = 0.0;
};

struct Candidate
{
  PixelTest test;
  int64_t moment_percent;  ///< its correlation with m10
};

/// Sum of twelve uniform numbers of up to 255: nearly normal, mean 0, sigma 10 px after scaling. (Distributions of the
/// standard library differ from one implementation to the next, its generators do not.)
int drawCoordinate(std::mt19937& random)
{
  int sum = -12 * 255 / 2;
  for (int i = 0; i < 12; ++i)
  {
    sum += static_cast<int>(random() >> 24);
  }
  return (sum * 100 + (sum < 0 ? -1280 : 1280)) / 2560;
}

Pixel drawPixel(std::mt19937& random)
{
  for (;;)
  {
    const int x = drawCoordinate(random);
    const Pixel pixel{x, drawCoordinate(random)};
    if (inDisc(pixel, ORB_TEST_RADIUS))
    {
      return pixel;
    }
  }
}

std::vector<Candidate> drawCandidates()
{
  const Moment moment;
  std::mt19937 random(20110611);
  std::vector<Candidate> candidates;
  while (candidates.size() < CANDIDATES)
  {
    const Pixel a = drawPixel(random);
    const Pixel b = drawPixel(random);
    if (squaredDistance(a, b) < SHORTEST * SHORTEST)
    {
      continue;
    }
    const int64_t variance = 2 * (ONE - covariance(a, b));
    candidates.push_back({{a, b, variance}, moment.percent(a, b, variance)});
  }
  return candidates;
}

bool correlated(const PixelTest& s, const PixelTest& t, int64_t percent)
{
  const int64_t c = covariance(s, t);
  return 10000 * c * c > percent * percent * s.variance * t.variance;
}

std::vector<PixelTest> chooseTests()
{
  const std::vector<Candidate> candidates = drawCandidates();
  for (int64_t bound = FIRST_BOUND;; ++bound)
  {
    std::vector<PixelTest> chosen;
    for (const Candidate& candidate : candidates)
    {
      bool fits = 5 * candidate.moment_percent <= 2 * bound;
      for (size_t i = 0; fits && i < chosen.size(); ++i)
      {
        fits = !correlated(candidate.test, chosen[i], bound);
      }
      if (fits)
      {
        chosen.push_back(candidate.test);
        if (chosen.size() == ORB_BITS)
        {
          return chosen;
        }
      }
    }
  }
}

cv::Mat smooth(const cv::Mat& image)
{
  cv::Mat result;
  cv::GaussianBlur(image, result, cv::Size(7, 7), 2, 2);
  return result;
}

struct Features
{
  cv::Mat descriptors;
  std::vector<float> angles;  ///< by the intensity centroid of the disc [rad]
};

float angleAt(const cv::Mat& image, const cv::Point& point)
{
  double m10 = 0.0;
  double m01 = 0.0;
  for (int y = -ORB_RADIUS; y <= ORB_RADIUS; ++y)
  {
    for (int x = -ORB_RADIUS; x <= ORB_RADIUS; ++x)
    {
      const double level = inDisc({x, y}, ORB_RADIUS) ? image.at<uint8_t>(point.y + y, point.x + x) : 0;
      m10 += x * level;
      m01 += y * level;
    }
  }
  return static_cast<float>(std::atan2(m01, m10));
}

Features describe(const cv::Mat& image, const std::vector<cv::Point2f>& points)
{
  const cv::Mat smoothed = smooth(image);
  Features features{cv::Mat::zeros(static_cast<int>(points.size()), ORB_BYTES, CV_8U), {}};
  for (size_t p = 0; p < points.size(); ++p)
  {
    const cv::Point point(cvRound(points[p].x), cvRound(points[p].y));
    const float angle = angleAt(image, point);
    features.angles.push_back(angle);
    const auto level = [&](int i)
    {
      const float x = static_cast<float>(ORB_PATTERN.x[i]);
      const float y = static_cast<float>(ORB_PATTERN.y[i]);
      return smoothed.at<uint8_t>(point.y + cvRound(x * std::sin(angle) + y * std::cos(angle)),
                                  point.x + cvRound(x * std::cos(angle) - y * std::sin(angle)));
    };
    for (int i = 0; i < ORB_BITS; ++i)
    {
      features.descriptors.at<uint8_t>(static_cast<int>(p), i / 8) |= (level(i) < level(i + ORB_BITS)) << (i % 8);
    }
  }
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

TEST(OrbPattern, TestsLieInTheDiscAndDifferFromEachOther)
{
  std::set<std::array<int, 4>> seen;
  for (int i = 0; i < 2 * ORB_BITS; ++i)
  {
    EXPECT_LE(ORB_PATTERN.x[i] * ORB_PATTERN.x[i] + ORB_PATTERN.y[i] * ORB_PATTERN.y[i],
              ORB_TEST_RADIUS * ORB_TEST_RADIUS);
  }
  for (int i = 0; i < ORB_BITS; ++i)
  {
    const int j = i + ORB_BITS;
    seen.insert({ORB_PATTERN.x[i], ORB_PATTERN.y[i], ORB_PATTERN.x[j], ORB_PATTERN.y[j]});
  }
  EXPECT_EQ(seen.size(), static_cast<size_t>(ORB_BITS));
}

TEST(OrbPattern, IsWhatTheSearchFinds)
{
  const std::vector<PixelTest> tests = chooseTests();
  for (int i = 0; i < ORB_BITS; ++i)
  {
    const auto [a, b, variance] = tests[static_cast<size_t>(i)];
    EXPECT_EQ(std::tie(a.x, a.y), std::make_tuple(ORB_PATTERN.x[i], ORB_PATTERN.y[i])) << "test " << i;
    EXPECT_EQ(std::tie(b.x, b.y), std::make_tuple(ORB_PATTERN.x[i + ORB_BITS], ORB_PATTERN.y[i + ORB_BITS]));
  }
}

TEST(OrbPattern, TurnedTestsStayInTheDisc)
{
  for (int degrees = 0; degrees < 360; ++degrees)
  {
    const double c = std::cos(degrees * CV_PI / 180.0);
    const double s = std::sin(degrees * CV_PI / 180.0);
    for (int i = 0; i < 2 * ORB_BITS; ++i)
    {
      ASSERT_LE(std::abs(cvRound(ORB_PATTERN.x[i] * c - ORB_PATTERN.y[i] * s)), ORB_TEST_RADIUS);
      ASSERT_LE(std::abs(cvRound(ORB_PATTERN.x[i] * s + ORB_PATTERN.y[i] * c)), ORB_TEST_RADIUS);
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
cv::Mat openCvs(const cv::Mat& image, const std::vector<cv::Point2f>& points, const std::vector<float>& angles)
{
  std::vector<cv::KeyPoint> keypoints;
  for (size_t i = 0; i < points.size(); ++i)
  {
    keypoints.emplace_back(points[i], 31.0F, angles[i] * 180.0F / static_cast<float>(CV_PI), 1.0F, 0);
  }
  cv::Mat descriptors;
  cv::ORB::create(500, 1.2F, 1)->compute(image, keypoints, descriptors);
  return descriptors;
}

TEST(OrbPattern, MatchesTurnedAndNoisyPicturesAsWellAsOpenCvsLearnedPattern)
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

}  // namespace
}  // namespace pi_runtime::kernels
