#include <gtest/gtest.h>
#include "evaluation/trajectory_plot.h"

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "temporary_folder.h"

namespace
{

using namespace pi_slam;

constexpr int64_t SECOND = 1000000000;
const cv::Rect TOP_VIEW(70, 130, 690, 490);
const cv::Rect POSITION_ERROR(860, 130, 690, 310);
const cv::Rect ROTATION_ERROR(860, 545, 690, 325);
const cv::Rect LEGEND(60, 935, 1500, 40);

/// Pixels of about a colour (BGR).
int count(const cv::Mat& picture, const cv::Rect& area, const cv::Scalar& color)
{
  const cv::Scalar tolerance(12, 12, 12);
  cv::Mat mask;
  cv::inRange(picture(area), color - tolerance, color + tolerance, mask);
  return cv::countNonZero(mask);
}

const cv::Scalar BLUE(178, 114, 0);     // first trajectory
const cv::Scalar ORANGE(0, 94, 213);    // second one
const cv::Scalar GREY(150, 145, 140);   // truth
const cv::Scalar SHADE(200, 225, 255);  // first kind of span

StampedPose poseAt(int64_t stamp_ns, double x, double y)
{
  StampedPose pose;
  pose.stamp_ns = stamp_ns;
  pose.T_world_body.translation() = Eigen::Vector3d(x, y, 0.1 * std::sin(x));
  return pose;
}

/// A circle of 3 m with errors that grow.
TrajectoryPlot makePlot()
{
  TrajectoryPlot plot;
  plot.title = "circle: ATE 12.0 mm";
  plot.subtitle = "for a test";
  PlottedTrajectory estimate;
  estimate.name = "odometry";
  for (int i = 0; i <= 200; ++i)
  {
    const double angle = 2.0 * M_PI * i / 200.0;
    const int64_t stamp_ns = 1000 * SECOND + i * SECOND / 20;
    plot.truth.push_back(poseAt(stamp_ns, 3.0 * std::cos(angle), 3.0 * std::sin(angle)));
    estimate.poses.push_back(poseAt(stamp_ns, 3.2 * std::cos(angle), 3.2 * std::sin(angle)));
    estimate.error_stamps.push_back(stamp_ns);
    estimate.position_errors.push_back(0.001 * i);
    estimate.rotation_errors.push_back(0.0002 * i);
  }
  plot.trajectories.push_back(estimate);
  return plot;
}

TEST(TrajectoryPlot, HasThePromisedSize)
{
  const cv::Mat picture = drawTrajectoryPlot(makePlot());
  EXPECT_EQ(picture.size(), cv::Size(1600, 1000));
  EXPECT_EQ(picture.type(), CV_8UC3);
}

TEST(TrajectoryPlot, ShowsEstimateTruthAndErrors)
{
  const cv::Mat picture = drawTrajectoryPlot(makePlot());
  EXPECT_GT(count(picture, TOP_VIEW, BLUE), 500);
  EXPECT_GT(count(picture, TOP_VIEW, GREY), 500);
  EXPECT_GT(count(picture, POSITION_ERROR, BLUE), 300);
  EXPECT_GT(count(picture, ROTATION_ERROR, BLUE), 300);
  EXPECT_GT(count(picture, LEGEND, BLUE), 30);
  EXPECT_EQ(count(picture, TOP_VIEW, ORANGE), 0);
}

TEST(TrajectoryPlot, ScalesBothDirectionsOfThePathEqually)
{
  // The circle of truth is as wide as it is high.
  TrajectoryPlot plot = makePlot();
  plot.trajectories[0].poses.resize(1);
  const cv::Mat picture = drawTrajectoryPlot(plot);
  cv::Mat mask;
  cv::inRange(picture(TOP_VIEW), GREY - cv::Scalar::all(4), GREY + cv::Scalar::all(4), mask);
  mask.row(0) = mask.row(mask.rows - 1) = mask.col(0) = mask.col(mask.cols - 1) = 0;  // not the frame
  const cv::Rect circle = cv::boundingRect(mask);
  EXPECT_GT(circle.width, 300);
  EXPECT_NEAR(circle.width, circle.height, 4);
}

TEST(TrajectoryPlot, ErrorsRiseFromLeftToRight)
{
  const cv::Mat picture = drawTrajectoryPlot(makePlot());
  const cv::Rect left_half(POSITION_ERROR.x, POSITION_ERROR.y, POSITION_ERROR.width / 2,
                           POSITION_ERROR.height / 2 - 20);
  const cv::Rect right_half = left_half + cv::Point(POSITION_ERROR.width / 2, 0);
  EXPECT_EQ(count(picture, left_half, BLUE), 0);
  EXPECT_GT(count(picture, right_half, BLUE), 100);
}

TEST(TrajectoryPlot, ShadesSpansAndDrawsASecondTrajectory)
{
  TrajectoryPlot plot = makePlot();
  plot.trajectories.push_back(plot.trajectories[0]);
  plot.trajectories[1].name = "map";
  for (StampedPose& pose : plot.trajectories[1].poses)
  {
    pose.T_world_body.translation().x() += 0.5;
  }
  EXPECT_EQ(count(drawTrajectoryPlot(plot), POSITION_ERROR, SHADE), 0);
  plot.spans.push_back({"blind", 1002 * SECOND, 1003 * SECOND});
  const cv::Mat picture = drawTrajectoryPlot(plot);
  // A tenth of the area, less the lines in it.
  EXPECT_GT(count(picture, POSITION_ERROR, SHADE), POSITION_ERROR.area() / 13);
  EXPECT_LT(count(picture, POSITION_ERROR, SHADE), POSITION_ERROR.area() / 9);
  EXPECT_GT(count(picture, TOP_VIEW, ORANGE), 500);
}

TEST(TrajectoryPlot, ShowsTheMotionWithoutTruth)
{
  TrajectoryPlot plot = makePlot();
  plot.truth.clear();
  plot.trajectories[0].error_stamps.clear();
  plot.trajectories[0].position_errors.clear();
  plot.trajectories[0].rotation_errors.clear();
  const cv::Mat picture = drawTrajectoryPlot(plot);
  EXPECT_GT(count(picture, POSITION_ERROR, BLUE), 300);  // distance from the start
  EXPECT_GT(count(picture, ROTATION_ERROR, BLUE), 300);  // heading
}

TEST(TrajectoryPlot, SurvivesEmptyAndUselessNumbers)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  TrajectoryPlot plot;
  plot.title = "\xcf\x80 and \xff";
  plot.trajectories.emplace_back();
  EXPECT_EQ(drawTrajectoryPlot(plot).cols, 1600);  // nothing at all

  plot.trajectories[0].poses = {poseAt(5 * SECOND, 1.0, 1.0)};
  EXPECT_EQ(drawTrajectoryPlot(plot).cols, 1600);  // one point

  plot.trajectories[0].poses = {poseAt(5 * SECOND, nan, 1.0), poseAt(6 * SECOND, 1e300, -1e300),
                                poseAt(7 * SECOND, 0.0, 0.0)};
  plot.trajectories[0].error_stamps = {5 * SECOND, 6 * SECOND};
  plot.trajectories[0].position_errors = {nan, 1e300};
  plot.trajectories[0].rotation_errors = {0.0, std::numeric_limits<double>::infinity()};
  EXPECT_EQ(drawTrajectoryPlot(plot).cols, 1600);

  plot.trajectories[0].poses = {poseAt(5 * SECOND, 9e11, 0.0), poseAt(6 * SECOND, 9e11, 0.0)};
  plot.trajectories[0].position_errors = {9e11, 9e11};
  EXPECT_EQ(drawTrajectoryPlot(plot).cols, 1600);  // steps that a double of that size hardly can tell
}

TEST(TrajectoryPlot, RefusesWhatDoesNotFitTogether)
{
  EXPECT_NE(messageOf<std::invalid_argument>([] { drawTrajectoryPlot({}); }).find("no trajectory"), std::string::npos);
  TrajectoryPlot plot = makePlot();
  plot.trajectories[0].rotation_errors.pop_back();
  EXPECT_NE(messageOf<std::invalid_argument>([&] { drawTrajectoryPlot(plot); })
                .find("odometry has 201 stamps, 201 errors of position and 200 of rotation"),
            std::string::npos);
}

}  // namespace
