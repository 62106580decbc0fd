#include "estimator/triangulation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

using namespace pi_slam;
using namespace pi_slam::estimator;

namespace
{

/// Keyframes a quarter of a metre apart along y, that look along x.
WindowProblem makeProblem(size_t keyframes)
{
  WindowProblem problem;
  problem.cameras = cameraGeometry(StereoCalibration::makeForwardPair());
  for (size_t i = 0; i < keyframes; ++i)
  {
    Keyframe keyframe;
    keyframe.state.p = Eigen::Vector3d(0.0, 0.25 * static_cast<double>(i), 0.0);
    problem.keyframes.push_back(keyframe);
  }
  return problem;
}

void addView(const WindowProblem& problem, size_t keyframe, int camera, const Eigen::Vector3d& p_odom,
             const Eigen::Vector2d& noise_px, Landmark* landmark)
{
  const CameraGeometry& geometry = problem.cameras[camera];
  const NavState& state = problem.keyframes[keyframe].state;
  View view;
  view.keyframe = problem.first_keyframe + keyframe;
  view.camera = camera;
  const Eigen::Vector3d bearing =
      (geometry.R_camera_body * (state.q.conjugate() * (p_odom - state.p)) + geometry.p_camera_body).normalized();
  view.bearing = (bearing + tangentBasis(bearing).transpose() * noise_px / geometry.focal_px).normalized();
  view.tangent = viewTangent(geometry, view.bearing);
  landmark->views.push_back(view);
}

}  // namespace

TEST(Triangulate, FindsThePointThatAllRaysMeet)
{
  const WindowProblem problem = makeProblem(3);
  const Eigen::Vector3d p_odom(4.0, 0.5, -0.3);
  Landmark landmark;
  for (size_t keyframe = 0; keyframe < 3; ++keyframe)
  {
    addView(problem, keyframe, LEFT, p_odom, Eigen::Vector2d::Zero(), &landmark);
    addView(problem, keyframe, RIGHT, p_odom, Eigen::Vector2d::Zero(), &landmark);
  }
  ASSERT_TRUE(triangulate(problem, 3.0, &landmark));
  EXPECT_TRUE(landmark.known);
  EXPECT_LT((landmark.estimate.p_odom - p_odom).norm(), 1e-6);
}

TEST(Triangulate, TellsHowFarItMayBeOff)
{
  const WindowProblem problem = makeProblem(2);
  const Eigen::Vector3d p_odom(4.0, 0.5, -0.3);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  constexpr int RUNS = 500;
  double nees = 0.0;
  for (int run = 0; run < RUNS; ++run)
  {
    Landmark landmark;
    for (size_t keyframe = 0; keyframe < 2; ++keyframe)
    {
      for (int camera : {LEFT, RIGHT})
      {
        addView(problem, keyframe, camera, p_odom, 0.5 * Eigen::Vector2d{normal(random), normal(random)}, &landmark);
        landmark.views.back().tangent =
            tangentBasis(landmark.views.back().bearing) * problem.cameras[camera].focal_px / 0.5;
      }
    }
    ASSERT_TRUE(triangulate(problem, 3.0, &landmark));
    const Eigen::Vector3d error = landmark.estimate.p_odom - p_odom;
    nees += error.dot(landmark.estimate.covariance.inverse() * error) / RUNS;
  }
  // Mean of 500 chi-square numbers of 3 degrees of freedom: deviation 0.11. Huber's weights lower information by some
  // percent.
  EXPECT_NEAR(nees, 3.0, 0.45);
}

TEST(Triangulate, RefusesRaysThatAreNearlyParallel)
{
  const WindowProblem problem = makeProblem(1);
  const Eigen::Vector3d p_odom(400.0, 0.0, 0.0);  // parallax of 0.3 mrad over the baseline of 0.12 m
  Landmark landmark;
  addView(problem, 0, LEFT, p_odom, Eigen::Vector2d::Zero(), &landmark);
  addView(problem, 0, RIGHT, p_odom, Eigen::Vector2d::Zero(), &landmark);
  EXPECT_FALSE(triangulate(problem, 3.0, &landmark));
  EXPECT_FALSE(landmark.known);
}

TEST(Triangulate, RefusesRaysThatMeetBehindTheCameras)
{
  const WindowProblem problem = makeProblem(1);
  Landmark landmark;
  // The left camera looks to its left, the right one to its right.
  addView(problem, 0, LEFT, Eigen::Vector3d(4.0, 1.0, 0.0), Eigen::Vector2d::Zero(), &landmark);
  addView(problem, 0, RIGHT, Eigen::Vector3d(4.0, -1.0, 0.0), Eigen::Vector2d::Zero(), &landmark);
  EXPECT_FALSE(triangulate(problem, 1e9, &landmark));
}

TEST(Triangulate, RefusesRaysThatDoNotMeet)
{
  const WindowProblem problem = makeProblem(2);
  const Eigen::Vector3d p_odom(4.0, 0.5, 0.0);
  Landmark landmark;
  addView(problem, 0, LEFT, p_odom, Eigen::Vector2d::Zero(), &landmark);
  addView(problem, 0, RIGHT, p_odom, Eigen::Vector2d(0.0, 40.0), &landmark);
  addView(problem, 1, LEFT, p_odom, Eigen::Vector2d(40.0, 0.0), &landmark);
  EXPECT_FALSE(triangulate(problem, 3.0, &landmark));
}

TEST(Triangulate, RefusesASingleViewAndWhatIsNotFinite)
{
  const WindowProblem problem = makeProblem(1);
  Landmark landmark;
  addView(problem, 0, LEFT, Eigen::Vector3d(4.0, 0.5, 0.0), Eigen::Vector2d::Zero(), &landmark);
  EXPECT_FALSE(triangulate(problem, 3.0, &landmark));
  addView(problem, 0, RIGHT, Eigen::Vector3d(4.0, 0.5, 0.0), Eigen::Vector2d::Zero(), &landmark);
  ASSERT_TRUE(triangulate(problem, 3.0, &landmark));
  landmark.views.back().bearing.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(triangulate(problem, 3.0, &landmark));
  EXPECT_FALSE(landmark.known);
  landmark.views.clear();
  EXPECT_FALSE(triangulate(problem, 3.0, &landmark));
}
