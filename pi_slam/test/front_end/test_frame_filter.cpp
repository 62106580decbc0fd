#include "front_end/frame_filter.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>
#include <random>

using namespace pi_slam;

namespace
{

const StereoCalibration CALIBRATION = StereoCalibration::makeForwardPair();

Matrix15d someCovariance()
{
  Vector15d deviation;
  deviation << Eigen::Vector3d::Constant(0.02), Eigen::Vector3d::Constant(0.01), Eigen::Vector3d::Constant(0.05),
      Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(0.02);
  Matrix15d covariance = deviation.cwiseAbs2().asDiagonal();
  // Velocity and position belong together, as after some time of integration.
  covariance.block<3, 3>(0, 6).diagonal().setConstant(5e-4);
  covariance.block<3, 3>(6, 0).diagonal().setConstant(5e-4);
  return covariance;
}

/// Points in front of a body at the origin that looks along x.
std::vector<Eigen::Vector3d> somePoints(size_t count)
{
  std::mt19937 random(7);
  std::uniform_real_distribution<double> depth(2.0, 8.0);
  std::uniform_real_distribution<double> side(-0.6, 0.6);
  std::vector<Eigen::Vector3d> points;
  for (size_t i = 0; i < count; ++i)
  {
    const double x = depth(random);
    points.emplace_back(x, x * side(random), x * side(random));
  }
  return points;
}

std::vector<LandmarkView> viewsFrom(const NavState& state, const std::vector<Eigen::Vector3d>& points, double noise_px,
                                    std::mt19937* random)
{
  std::normal_distribution<double> normal;
  std::vector<LandmarkView> views;
  const MountedCamera* const cameras[2] = {&CALIBRATION.left, &CALIBRATION.right};
  for (size_t i = 0; i < points.size(); ++i)
  {
    for (int camera = 0; camera < 2; ++camera)
    {
      LandmarkView view;
      view.id = static_cast<int64_t>(i);
      view.camera = camera;
      const Eigen::Vector3d p_camera = (state.T_odom_body() * cameras[camera]->T_body_camera).inverse() * points[i];
      Eigen::Vector2d pixel = *cameras[camera]->model.project(p_camera);
      if (random != nullptr)
      {
        pixel += noise_px * Eigen::Vector2d{normal(*random), normal(*random)};
      }
      view.bearing = *cameras[camera]->model.unproject(pixel);
      view.p_odom = points[i];
      view.covariance = 1e-6 * Eigen::Matrix3d::Identity();
      views.push_back(view);
    }
  }
  return views;
}

ImuPreintegration restingImu(const ImuModel& model, const ImuBias& bias, int64_t start_ns, double duration_s)
{
  ImuPreintegration imu(model, bias);
  ImuSample from;
  from.stamp_ns = start_ns;
  from.w = bias.gyro;
  from.f = Eigen::Vector3d(0, 0, model.gravity) + bias.accel;
  const int64_t end_ns = start_ns + static_cast<int64_t>(1e9 * duration_s);
  while (from.stamp_ns < end_ns)
  {
    ImuSample to = from;
    to.stamp_ns = std::min(from.stamp_ns + 5000000, end_ns);
    imu.append(from, to);
    from = to;
  }
  return imu;
}

void expectProper(const Matrix15d& covariance)
{
  ASSERT_TRUE(covariance.allFinite());
  EXPECT_LE((covariance - covariance.transpose()).cwiseAbs().maxCoeff(), 1e-12 * covariance.cwiseAbs().maxCoeff());
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix15d>(covariance).eigenvalues()(0), 0.0);
}

}  // namespace

TEST(FrameFilter, PredictsAsTheIntegralDoesAndGrowsLessCertain)
{
  const ImuModel model;
  NavState state;
  state.v = Eigen::Vector3d(1.0, 0.0, 0.0);
  FrameFilter filter(CALIBRATION, 1.0);
  filter.reset(state, someCovariance());
  const ImuPreintegration imu = restingImu(model, state.bias, 0, 0.5);
  filter.predict(imu);
  const NavState expected = imu.predict(state);
  EXPECT_EQ(filter.state().p, expected.p);
  EXPECT_EQ(filter.state().stamp_ns, 500000000);
  Matrix15d F, Q;
  imu.transition(state, &F, &Q);
  const Matrix15d covariance = F * someCovariance() * F.transpose() + Q;
  EXPECT_LT((filter.covariance() - covariance).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_GT(filter.covariance().trace(), someCovariance().trace());
  expectProper(filter.covariance());
}

TEST(FrameFilter, FindsThePoseThatTheViewsAgreeOn)
{
  NavState truth;
  FrameFilter filter(CALIBRATION, 1.0);
  NavState guess = truth;
  Vector15d error = Vector15d::Zero();
  error.head<6>() << 0.02, -0.03, 0.01, 0.01, -0.01, 0.015;
  guess.boxPlus(error);
  filter.reset(guess, someCovariance());
  const FilterReport report = filter.update(viewsFrom(truth, somePoints(60), 0.0, nullptr), 10);
  EXPECT_TRUE(report.updated);
  EXPECT_EQ(report.used, 120);
  EXPECT_EQ(report.refused, 0);
  EXPECT_TRUE(report.outliers.empty());
  EXPECT_GT(report.iterations, 1);
  // What remains is the guess's weight against that of 120 views.
  EXPECT_LT(filter.state().boxMinus(truth).head<3>().norm(), 2e-3);
  EXPECT_LT(filter.state().boxMinus(truth).segment<3>(3).norm(), 5e-4);
  // The velocity follows by its correlation with the position: 0.0005 / 0.02^2 of it.
  EXPECT_NEAR(filter.state().v.x(), -0.02 * 1.25, 5e-3);
  expectProper(filter.covariance());
}

TEST(FrameFilter, EqualsTheBatchSolutionWhereAllIsLinear)
{
  // So near the truth and with so small a covariance that nothing bends.
  NavState truth;
  const Matrix15d covariance = 1e-2 * someCovariance();
  std::mt19937 random(3);
  // Half the noise that the filter is told, so that no view is beyond Huber's bound.
  const double noise_px = 0.1;
  std::vector<LandmarkView> views = viewsFrom(truth, somePoints(20), 0.5 * noise_px, &random);
  for (LandmarkView& view : views)
  {
    view.covariance.setZero();
  }
  FrameFilter filter(CALIBRATION, noise_px);
  NavState guess = truth;
  guess.boxPlus(Vector15d::Constant(1e-4));
  filter.reset(guess, covariance);

  // Two updates, one after the other, are one with all views.
  const std::vector<LandmarkView> first(views.begin(), views.begin() + 20);
  const std::vector<LandmarkView> second(views.begin() + 20, views.end());
  ASSERT_TRUE(filter.update(first, 5).updated);
  ASSERT_TRUE(filter.update(second, 5).updated);

  FrameFilter batch(CALIBRATION, noise_px);
  batch.reset(guess, covariance);
  ASSERT_TRUE(batch.update(views, 5).updated);

  // And that is the least-squares solution, with derivatives by differences of the pixels.
  Matrix15d H = covariance.inverse();
  Vector15d b = Vector15d::Zero();
  const MountedCamera* const cameras[2] = {&CALIBRATION.left, &CALIBRATION.right};
  for (const LandmarkView& view : views)
  {
    const auto pixel = [&](const Vector15d& delta)
    {
      NavState moved = guess;
      moved.boxPlus(delta);
      return *cameras[view.camera]->model.project(
          (moved.T_odom_body() * cameras[view.camera]->T_body_camera).inverse() * view.p_odom);
    };
    Eigen::Matrix<double, 2, 15> J = Eigen::Matrix<double, 2, 15>::Zero();
    for (int i = 0; i < 6; ++i)
    {
      Vector15d step = Vector15d::Zero();
      step(i) = 1e-5;
      J.col(i) = (pixel(step) - pixel(-step)) / 2e-5;
    }
    const Eigen::Vector2d error = pixel(Vector15d::Zero()) - *cameras[view.camera]->model.project(view.bearing);
    H += J.transpose() * J / (noise_px * noise_px);
    b += J.transpose() * error / (noise_px * noise_px);
  }
  NavState expected = guess;
  expected.boxPlus(-H.llt().solve(b));
  const Vector15d deviation = H.inverse().diagonal().cwiseSqrt();
  EXPECT_LT(batch.state().boxMinus(expected).cwiseQuotient(deviation).cwiseAbs().maxCoeff(), 2e-2);
  EXPECT_LT((batch.covariance() - H.inverse()).cwiseAbs().maxCoeff(), 1e-2 * H.inverse().cwiseAbs().maxCoeff());
  EXPECT_LT(filter.state().boxMinus(batch.state()).cwiseQuotient(deviation).cwiseAbs().maxCoeff(), 2e-2);
}

TEST(FrameFilter, IsAsWrongAsItsCovarianceSays)
{
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  const Matrix15d covariance = someCovariance();
  const Matrix15d L = covariance.llt().matrixL();
  constexpr int RUNS = 200;
  double nees = 0.0;
  for (int run = 0; run < RUNS; ++run)
  {
    NavState truth;
    NavState guess = truth;
    Vector15d white;
    for (int i = 0; i < 15; ++i)
    {
      white(i) = normal(random);
    }
    guess.boxPlus(L * white);
    FrameFilter filter(CALIBRATION, 1.0);
    filter.reset(guess, covariance);
    ASSERT_TRUE(filter.update(viewsFrom(truth, somePoints(40), 1.0, &random), 10).updated);
    const Vector15d error = truth.boxMinus(filter.state());
    nees += error.dot(filter.covariance().llt().solve(error)) / RUNS;
  }
  // Mean of 200 chi-square numbers of 15 degrees of freedom: 95 % in 15 +- 0.76. Huber's weights take some information
  // away without need, the views' second order adds some error: 15 % either way.
  EXPECT_GT(nees, 15.0 * 0.85);
  EXPECT_LT(nees, 15.0 * 1.15);
}

TEST(FrameFilter, LeavesOutViewsThatDisagree)
{
  NavState truth;
  FrameFilter filter(CALIBRATION, 1.0);
  filter.reset(truth, someCovariance());
  std::vector<LandmarkView> views = viewsFrom(truth, somePoints(40), 0.0, nullptr);
  views[10].p_odom += Eigen::Vector3d(0.0, 3.0, 0.0);  // landmark 5, both cameras
  views[11].p_odom += Eigen::Vector3d(0.0, 3.0, 0.0);
  views[20].p_odom = Eigen::Vector3d(-5.0, 0.0, 0.0);                     // landmark 10, behind
  views[30].bearing.y() = std::numeric_limits<double>::quiet_NaN();       // landmark 15
  views[41].p_odom.x() = std::numeric_limits<double>::quiet_NaN();        // landmark 20
  views[51].covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();  // landmark 25
  const FilterReport report = filter.update(views, 10);
  EXPECT_TRUE(report.updated);
  EXPECT_EQ(report.refused, 6);
  EXPECT_EQ(report.outliers, (std::vector<int64_t>{5, 10, 15, 20, 25}));
  EXPECT_LT(filter.state().boxMinus(truth).norm(), 1e-6);
  expectProper(filter.covariance());
}

TEST(FrameFilter, StaysAsPredictedWithTooFewViews)
{
  NavState truth;
  FrameFilter filter(CALIBRATION, 1.0);
  filter.reset(truth, someCovariance());
  EXPECT_FALSE(filter.update({}, 1).updated);
  EXPECT_FALSE(filter.update(viewsFrom(truth, somePoints(4), 0.0, nullptr), 9).updated);
  EXPECT_EQ(filter.covariance(), someCovariance());
  EXPECT_EQ(filter.state().p, truth.p);
}

TEST(FrameFilter, HoldsThePoseOfTheAnchorAndLearnsTheGyroBiasStandingStill)
{
  const ImuModel model;
  ImuBias actual;
  actual.gyro = Eigen::Vector3d(1e-3, -5e-4, 8e-4);
  NavState anchor;
  FrameFilter filter(CALIBRATION, 1.0);
  // With respect to the landmarks the pose is known.
  Matrix15d relative = someCovariance();
  relative.topRows<6>().setZero();
  relative.leftCols<6>().setZero();
  relative.topLeftCorner<6, 6>().diagonal().setConstant(1e-10);
  filter.reset(anchor, relative);
  for (int pair = 0; pair < 400; ++pair)
  {
    // The samples have the bias that the state does not know yet.
    ImuPreintegration imu = restingImu(model, actual, filter.state().stamp_ns, 0.05);
    imu.reintegrate(filter.state().bias);
    filter.predict(imu);
    filter.holdStill(anchor, relative);
    ASSERT_EQ(filter.state().p, anchor.p);
    ASSERT_EQ(filter.state().v, Eigen::Vector3d(Eigen::Vector3d::Zero()));
  }
  expectProper(filter.covariance());
  const Matrix6d pose = filter.covariance().topLeftCorner<6, 6>();
  EXPECT_EQ(pose, (Matrix6d(relative.topLeftCorner<6, 6>())));
  EXPECT_LT((filter.state().bias.gyro - actual.gyro).norm(), 1e-4);
}

TEST(FrameFilter, KeepsAProperCovarianceOverTenThousandUpdates)
{
  const ImuModel model;
  NavState truth;
  FrameFilter filter(CALIBRATION, 1.0);
  filter.reset(truth, someCovariance());
  std::mt19937 random(5);
  const std::vector<Eigen::Vector3d> points = somePoints(12);
  for (int update = 0; update < 10000; ++update)
  {
    filter.predict(restingImu(model, ImuBias(), filter.state().stamp_ns, 0.01));
    filter.update(viewsFrom(truth, points, 1.0, &random), 6);
    if (update % 1000 == 0)
    {
      expectProper(filter.covariance());
    }
  }
  expectProper(filter.covariance());
  EXPECT_LT(filter.state().p.norm(), 0.02);
}
