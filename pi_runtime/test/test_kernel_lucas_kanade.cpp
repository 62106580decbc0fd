#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <stdexcept>

#include "kernel_test_images.h"
#include "kernel_test_runs.h"
#include <pi_runtime/kernels/lucas_kanade.h>

namespace pi_runtime
{
namespace
{

using kernels::Point2f;
using kernels::PyramidLayout;
using kernels::TrackOptions;

const CodeletPtr TRACK_POINTS = kernels::trackPointsCodelet();
using Points = std::vector<cv::Point2f>;

/// The image after a rotation [degrees] about its middle and a shift [px].
cv::Mat move(const cv::Mat& image, double degrees, double shift_x, double shift_y)
{
  cv::Mat motion = cv::getRotationMatrix2D(cv::Point2f(image.cols / 2.0f, image.rows / 2.0f), degrees, 1.0);
  motion.at<double>(0, 2) += shift_x;
  motion.at<double>(1, 2) += shift_y;
  cv::Mat moved;
  cv::warpAffine(image, moved, motion, image.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT_101);
  return moved;
}

Points cornersOf(const cv::Mat& image, int count)
{
  Points points;
  cv::goodFeaturesToTrack(image, points, count, 0.01, 8);
  return points;
}

struct Tracks
{
  Points points;
  std::vector<uint8_t> status;
  std::vector<float> residual;
};

/// One track_points task. Pyramids are made by the native twin.
struct TrackTask
{
  TrackTask(const cv::Mat& previous, const cv::Mat& next, const Points& from, const TrackOptions& options)
    : from(from)
    , next_points(Buffer::allocate(from.size() * sizeof(Point2f)))
    , status(Buffer::allocate(from.size()))
    , residual(Buffer::allocate(from.size() * sizeof(float)))
  {
    arguments = {Argument::in(pyramid(previous, options)),
                 Argument::in(pyramid(next, options)),
                 Argument::in(wrapMat(cv::Mat(from, true))),
                 Argument::inOut(next_points),
                 Argument::out(status),
                 Argument::out(residual),
                 Argument::value(options)};
  }

  static BufferPtr pyramid(const cv::Mat& image, const TrackOptions& options)
  {
    const PyramidLayout layout(options.width, options.height, options.levels);
    const BufferPtr buffer = Buffer::allocate(layout.bytes);
    kernels::buildPyramid({image.ptr(), image.cols, image.rows, image.step[0]}, layout,
                          buffer->hostAs<uint8_t>(Access::WRITE));
    return buffer;
  }

  void begin(const Points& guesses) const
  {
    std::memcpy(next_points->host(Access::WRITE), guesses.data(), next_points->bytes());
    std::memset(status->host(Access::WRITE), 0xa5, status->bytes());
    std::memset(residual->host(Access::WRITE), 0xa5, residual->bytes());
  }
  Tracks result() const
  {
    const auto* points = next_points->hostAs<cv::Point2f>(Access::READ);
    const auto* found = status->hostAs<uint8_t>(Access::READ);
    const auto* mean = residual->hostAs<float>(Access::READ);
    return {{points, points + from.size()}, {found, found + from.size()}, {mean, mean + from.size()}};
  }
  Tracks run(bool native) const
  {
    begin(from);
    runOn(native, TRACK_POINTS, arguments, from.size());
    return result();
  }

  Points from;
  BufferPtr next_points;
  BufferPtr status;
  BufferPtr residual;
  std::vector<Argument> arguments;
};

TrackOptions optionsFor(const cv::Mat& image, int window = 21, int levels = 4)
{
  TrackOptions options;
  options.width = image.cols;
  options.height = image.rows;
  options.window = window;
  options.levels = levels;
  return options;
}

Tracks openCvTracks(const cv::Mat& previous, const cv::Mat& next, const Points& from, const TrackOptions& options)
{
  Tracks tracks;
  tracks.points = from;
  cv::calcOpticalFlowPyrLK(
      previous, next, from, tracks.points, tracks.status, tracks.residual, cv::Size(options.window, options.window),
      options.levels - 1,
      cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, options.max_iterations, options.epsilon),
      cv::OPTFLOW_USE_INITIAL_FLOW, options.min_eigenvalue);
  return tracks;
}

double distance(const cv::Point2f& a, const cv::Point2f& b)
{
  return std::hypot(a.x - b.x, a.y - b.y);
}

/// Expects the same status and places for nearly all points.
void expectClose(const Tracks& a, const Tracks& b, double tolerance, double allowed_share, const std::string& where)
{
  ASSERT_EQ(a.points.size(), b.points.size());
  size_t differing = 0;
  for (size_t i = 0; i < a.points.size(); ++i)
  {
    const bool same_status = a.status[i] == b.status[i];
    const bool both = a.status[i] == 1 && b.status[i] == 1;
    const bool same_place =
        !both || (distance(a.points[i], b.points[i]) <= tolerance && std::abs(a.residual[i] - b.residual[i]) <= 0.1);
    differing += same_status && same_place ? 0 : 1;
  }
  EXPECT_LE(differing, allowed_share * a.points.size()) << where << ": of " << a.points.size() << " points";
}

int foundIn(const Tracks& tracks)
{
  return static_cast<int>(std::count(tracks.status.begin(), tracks.status.end(), 1));
}

TEST(TrackPoints, BothImplementationsAgreeWithOpenCvOnCorners)
{
  for (const cv::Size& size : {cv::Size(640, 480), cv::Size(752, 480), cv::Size(639, 479)})
  {
    const cv::Mat image = makeImage(Content::NATURAL, size.width, size.height);
    const cv::Mat moved = move(image, 1.0, 5.3, -3.8);
    const Points corners = cornersOf(image, 300);
    for (const int window : {9, 15, 21, 31})
    {
      const TrackOptions options = optionsFor(image, window);
      const TrackTask task(image, moved, corners, options);
      const Tracks expected = openCvTracks(image, moved, corners, options);
      const Tracks native = task.run(true);
      const std::string where = std::to_string(size.width) + " wide, window " + std::to_string(window);
      EXPECT_GT(foundIn(native), 0.9 * corners.size()) << where;
      // Sums of floats in another order may stop a search one step earlier or later.
      expectClose(native, expected, 0.005, 0.01, "native, " + where);
      expectClose(task.run(false), native, 0.001, 0.0, "opencl, " + where);
    }
  }
}

TEST(TrackPoints, FindsAKnownShift)
{
  // Two images with a quarter of the resolution of one scene, 49 and 30 of its pixels apart.
  const cv::Mat scene = makeImage(Content::NATURAL, 2560 + 49, 1920 + 30);
  cv::Mat image;
  cv::Mat moved;
  cv::resize(scene(cv::Rect(49, 0, 2560, 1920)), image, cv::Size(640, 480), 0, 0, cv::INTER_AREA);
  cv::resize(scene(cv::Rect(0, 30, 2560, 1920)), moved, cv::Size(640, 480), 0, 0, cv::INTER_AREA);
  const cv::Point2f shift(12.25f, -7.5f);
  Points inside;
  for (const cv::Point2f& point : cornersOf(image, 300))
  {
    if (cv::Rect(40, 40, 560, 400).contains(point))
    {
      inside.push_back(point);
    }
  }
  const Tracks tracks = TrackTask(image, moved, inside, optionsFor(image)).run(true);
  std::vector<double> errors;
  for (size_t i = 0; i < inside.size(); ++i)
  {
    errors.push_back(distance(tracks.points[i], inside[i] + shift));
  }
  std::sort(errors.begin(), errors.end());

  EXPECT_GT(inside.size(), 100u);
  EXPECT_LT(errors[errors.size() / 2], 0.03);
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.1);
}

TEST(TrackPoints, AgreesAtAndBeyondTheBorders)
{
  const cv::Mat image = makeImage(Content::NATURAL, 160, 120);
  const cv::Mat moved = move(image, 0.0, 1.7, 1.2);
  Points points;
  for (int i = -30; i <= 190; i += 3)
  {
    points.insert(points.end(), {cv::Point2f(i, 0.3f), cv::Point2f(i, 119.0f), cv::Point2f(0.0f, i),
                                 cv::Point2f(159.6f, i), cv::Point2f(i, -12.0f), cv::Point2f(172.0f, i)});
  }
  for (const int levels : {1, 3})
  {
    const TrackOptions options = optionsFor(image, 21, levels);
    const TrackTask task(image, moved, points, options);
    const Tracks native = task.run(true);
    expectClose(native, openCvTracks(image, moved, points, options), 0.005, 0.02, "native");
    expectClose(task.run(false), native, 0.001, 0.0, "opencl");
  }
}

TEST(TrackPoints, AgreesOnImagesWithoutStructureAndPureNoise)
{
  for (const Content content : {Content::CONSTANT, Content::GRADIENT, Content::RANDOM})
  {
    const cv::Mat image = makeImage(content, 320, 240, 1);
    const cv::Mat other = makeImage(content, 320, 240, 2);
    Points points;
    for (int i = 0; i < 60; ++i)
    {
      points.emplace_back(5.0f + 5.1f * static_cast<float>(i), 3.0f + 3.9f * static_cast<float>(i));
    }
    const TrackTask task(image, other, points, optionsFor(image));
    const Tracks native = task.run(true);
    expectClose(task.run(false), native, 0.001, 0.0, "opencl");
    EXPECT_EQ(foundIn(native) == 0, content == Content::CONSTANT);
  }
}

TEST(TrackPoints, StartsFromTheGuess)
{
  const cv::Mat image = makeImage(Content::NATURAL, 640, 480);
  const cv::Mat moved = move(image, 0.0, 60.0, 0.0);
  const Points from = {cornersOf(image, 1).front()};
  const TrackTask task(image, moved, from, optionsFor(image, 21, 1));
  for (const bool native : {true, false})
  {
    task.begin({from[0] + cv::Point2f(59.0f, 1.0f)});
    runOn(native, TRACK_POINTS, task.arguments, 1);
    EXPECT_LT(distance(task.result().points[0], from[0] + cv::Point2f(60.0f, 0.0f)), 0.1);
    EXPECT_GT(distance(task.run(native).points[0], from[0] + cv::Point2f(60.0f, 0.0f)), 10.0);
  }
}

TEST(TrackPoints, LosesWhatIsNotANumberOrFarAway)
{
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const cv::Mat image = makeImage(Content::NATURAL, 160, 120);
  const Points points = {{nan, 3.0f}, {1e20f, 3.0f}, {80.0f, -1e9f}, {-40.0f, 60.0f}, {80.0f, 150.0f}};
  const TrackTask task(image, image, points, optionsFor(image, 15, 2));
  for (const bool native : {true, false})
  {
    const Tracks tracks = task.run(native);
    EXPECT_EQ(foundIn(tracks), 0);
    EXPECT_EQ(tracks.residual, std::vector<float>(points.size(), 0.0f));
  }
}

TEST(TrackPoints, SlicesEqualTheWhole)
{
  const cv::Mat image = makeImage(Content::NATURAL, 320, 240);
  const Points corners = cornersOf(image, 100);
  const TrackTask task(image, move(image, 2.0, 1.0, 2.0), corners, optionsFor(image));
  const Tracks native = task.run(true);
  const Tracks opencl = task.run(false);

  task.begin(corners);
  CodeletRunner::shared().nativeSliced(TRACK_POINTS, task.arguments, corners.size(), 7);
  EXPECT_EQ(task.result().points, native.points);
  EXPECT_EQ(task.result().status, native.status);
  task.begin(corners);
  CodeletRunner::shared().openclSliced(TRACK_POINTS, task.arguments, corners.size(), 7);
  EXPECT_EQ(task.result().points, opencl.points);
  EXPECT_EQ(task.result().residual, opencl.residual);
}

TEST(TrackPoints, RefusesArgumentsThatDoNotFit)
{
  const cv::Mat image = makeImage(Content::NATURAL, 160, 120);
  const Points points(5, cv::Point2f(50.0f, 50.0f));
  const TrackOptions options = optionsFor(image);
  const TrackTask task(image, image, points, options);
  const auto with = [&task](size_t index, const Argument& argument)
  {
    std::vector<Argument> arguments = task.arguments;
    arguments[index] = argument;
    return arguments;
  };
  expectRefused(TRACK_POINTS, with(1, Argument::in(Buffer::allocate(50))), 5, "argument 1 (next pyramid) has 50 bytes");
  expectRefused(TRACK_POINTS, task.arguments, 6, "argument 2 (previous points) has 40 bytes, must have at least 48");
  expectRefused(TRACK_POINTS, with(4, Argument::out(Buffer::allocate(4))), 5, "argument 4 (status) has 4 bytes");
  TrackOptions wrong = options;
  wrong.window = 32;
  expectRefused(TRACK_POINTS, with(6, Argument::value(wrong)), 5, "window = 32, must be 3 to 31");
  wrong = options;
  wrong.epsilon = std::numeric_limits<float>::quiet_NaN();
  expectRefused(TRACK_POINTS, with(6, Argument::value(wrong)), 5, "epsilon = nan");
}

}  // namespace
}  // namespace pi_runtime
