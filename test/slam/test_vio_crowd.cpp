// Odometry at rest while people fill most of the picture: a texture that passes.
#include <opencv2/imgproc.hpp>

#include <cstdlib>

#include "vio_drive.h"

namespace pi_slam
{
namespace
{

/// @param length_s  of the rest; PI_SLAM_CROWD_S overrides it.
Drive restOf(double length_s)
{
  std::vector<StampedPose> poses;
  for (int i = 0; i <= static_cast<int>(50.0 * length_s); ++i)
  {
    StampedPose pose;
    pose.stamp_ns = 1700000000000000000LL + 20000000LL * i;
    pose.T_world_body.translation() = Eigen::Vector3d(0.0, 0.0, 1.0);
    poses.push_back(pose);
  }
  return Drive(poses, 2, WorldKind::HALL, 0.1, length_s + 1.0, 640);  // one picture is all of them
}

/// From 3 s on people pass in `part` of the picture at 1.5 m/s and 2 m away: 240 px/s, with 19 px of disparity.
Faults passing(const StereoFrame& still, const cv::Rect& part)
{
  cv::Mat crowd(480, 3200, CV_8UC1);
  cv::RNG random(1);
  random.fill(crowd, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(crowd, crowd, cv::Size(0, 0), 2.0);
  cv::normalize(crowd, crowd, 20, 235, cv::NORM_MINMAX);
  Faults faults;
  faults.pair = [=](double time_s, cv::Mat* left, cv::Mat* right, int64_t*)
  {
    *left = still.left.clone();
    *right = still.right.clone();
    if (time_s > 3.0)
    {
      const int at = static_cast<int>(240.0 * (time_s - 3.0)) % 2400;
      crowd(cv::Rect(2400 - at, part.y, part.width, part.height)).copyTo((*left)(part));
      crowd(cv::Rect(2400 - at + 19, part.y, part.width, part.height)).copyTo((*right)(part));
    }
    return true;
  };
  return faults;
}

struct CrowdTest : VioTest
{
  /// @param bound_m  of the farthest that the pose may go.
  void expectRest(double length_s, const cv::Rect& part, bool with_wheels, double bound_m, const char* warning)
  {
    length_s = std::getenv("PI_SLAM_CROWD_S") != nullptr ? std::atof(std::getenv("PI_SLAM_CROWD_S")) : length_s;
    const Drive drive = restOf(length_s);
    wheels_ = with_wheels ? simulateWheels(drive.trajectory, WheelSimulatorOptions()) : std::vector<WheelSample>();
    aligned_ = false;
    messages_.clear();
    Vio vio(drive.calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, passing(drive.frames.front(), part), drive);
    double most = 0.0;
    for (const Outcome& outcome : outcomes)
    {
      most = std::max(most, outcome.error_m);
    }
    EXPECT_TRUE(at(outcomes, 2.9).known);
    EXPECT_EQ(outcomes.back().report.status, VioStatus::STANDSTILL);
    EXPECT_TRUE(said(warning)) << allMessages();
    EXPECT_LT(most, bound_m);
    std::cout << length_s << " s in a crowd of " << part.area() / 3072 << " %: " << most << " m\n";
  }
};

const cv::Rect TWO_THIRDS(80, 20, 460, 430);
const cv::Rect MOST(0, 48, 640, 432);  // above their heads nothing has features

TEST_F(CrowdTest, RestsByWheels)
{
  expectRest(30.0, TWO_THIRDS, true, 0.02, "while wheels and IMU stand");
}

TEST_F(CrowdTest, RestsByWhatDoesNotMoveAndTheImu)
{
  expectRest(60.0, TWO_THIRDS, false, 0.05, "while the IMU says rest");
}

TEST_F(CrowdTest, RestsByTheImuWhereNothingElseIsSeen)
{
  expectRest(60.0, MOST, false, 0.2, "while the IMU says rest");
}

}  // namespace
}  // namespace pi_slam
