#include "estimator/factors.h"

#include <pi_slam/so3.h>

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

using namespace pi_slam;
using namespace pi_slam::estimator;

namespace
{

class Random
{
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double normal() { return normal_(engine_); }
  Eigen::Vector3d vector(double deviation) { return deviation * Eigen::Vector3d{normal(), normal(), normal()}; }
  Eigen::Quaterniond rotation() { return Eigen::Quaterniond{normal(), normal(), normal(), normal()}.normalized(); }

  NavState state()
  {
    NavState state;
    state.p = vector(5.0);
    state.q = rotation();
    state.v = vector(2.0);
    state.bias.gyro = vector(0.02);
    state.bias.accel = vector(0.1);
    return state;
  }

private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

/// Derivative of error(delta) at 0 by central differences.
template <int ROWS, int COLS>
Eigen::Matrix<double, ROWS, COLS> numericJacobian(
    const std::function<Eigen::Matrix<double, ROWS, 1>(const Eigen::Matrix<double, COLS, 1>&)>& error, double step)
{
  Eigen::Matrix<double, ROWS, COLS> J;
  for (int column = 0; column < COLS; ++column)
  {
    Eigen::Matrix<double, COLS, 1> delta = Eigen::Matrix<double, COLS, 1>::Zero();
    delta(column) = step;
    J.col(column) = (error(delta) - error(-delta)) / (2.0 * step);
  }
  return J;
}

/// A second and more of a lively motion, with the biases that an integral about `bias` is to be made with.
ImuPreintegration livelyImu(const ImuModel& model, const ImuBias& bias, double duration_s)
{
  ImuPreintegration imu(model, bias);
  const int64_t step_ns = 5000000;
  const auto sample = [](int64_t stamp_ns)
  {
    const double t = 1e-9 * static_cast<double>(stamp_ns);
    ImuSample sample;
    sample.stamp_ns = stamp_ns;
    sample.w = Eigen::Vector3d(0.6 * std::sin(3.0 * t), 0.4 * std::cos(2.0 * t), 0.8);
    sample.f = Eigen::Vector3d(1.5 * std::cos(4.0 * t), -0.8, 9.81 + std::sin(5.0 * t));
    return sample;
  };
  for (int64_t t = 0; t < static_cast<int64_t>(1e9 * duration_s); t += step_ns)
  {
    imu.append(sample(t), sample(t + step_ns));
  }
  return imu;
}

}  // namespace

TEST(TangentBasis, IsOrthonormalAndAcrossTheBearing)
{
  Random random(1);
  for (int i = 0; i < 100; ++i)
  {
    const Eigen::Vector3d bearing = i < 3 ? Eigen::Vector3d(Eigen::Vector3d::Unit(i)) : random.vector(1.0).normalized();
    const Eigen::Matrix<double, 2, 3> basis = tangentBasis(bearing);
    EXPECT_LT((basis * basis.transpose() - Eigen::Matrix2d::Identity()).norm(), 1e-12);
    EXPECT_LT((basis * bearing).norm(), 1e-12);
  }
}

TEST(ReprojectionError, IsZeroOnTheRayAndCountsPixelsBesideIt)
{
  CameraGeometry camera;
  camera.focal_px = 400.0;
  const Eigen::Vector3d bearing = Eigen::Vector3d::UnitZ();
  const Eigen::Matrix<double, 2, 3> tangent = tangentBasis(bearing) * camera.focal_px / 2.0;  // noise of 2 px
  const Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  const Eigen::Vector3d p = Eigen::Vector3d::Zero();
  EXPECT_LT(reprojectionError(R, p, camera, bearing, tangent, Eigen::Vector3d(0, 0, 5), nullptr, nullptr).norm(),
            1e-12);
  // One pixel aside: half a standard deviation, to the third order of the angle.
  EXPECT_NEAR(
      reprojectionError(R, p, camera, bearing, tangent, Eigen::Vector3d(1.0, 0, 400.0), nullptr, nullptr).norm(), 0.5,
      1e-5);
}

TEST(ReprojectionError, HasTheDerivativesThatDifferencesShow)
{
  Random random(2);
  int checked = 0;
  for (int trial = 0; trial < 200; ++trial)
  {
    CameraGeometry camera;
    camera.R_camera_body = random.rotation().toRotationMatrix();
    camera.p_camera_body = random.vector(0.1);
    const Eigen::Quaterniond q = random.rotation();
    const Eigen::Vector3d p = random.vector(3.0);
    const Eigen::Vector3d p_landmark = random.vector(6.0);
    const Eigen::Vector3d p_camera = camera.R_camera_body * (q.conjugate() * (p_landmark - p)) + camera.p_camera_body;
    if (p_camera.norm() < 0.5)
    {
      continue;  // differences are not accurate so near
    }
    const Eigen::Vector3d bearing = (p_camera.normalized() + random.vector(0.1)).normalized();
    const Eigen::Matrix<double, 2, 3> tangent = tangentBasis(bearing) * 450.0;
    const auto error = [&](const Eigen::Matrix<double, 9, 1>& delta) -> Eigen::Vector2d
    {
      const Eigen::Quaterniond moved = q * expSo3(delta.segment<3>(3));
      return reprojectionError(moved.toRotationMatrix(), p + delta.head<3>(), camera, bearing, tangent,
                               p_landmark + delta.tail<3>(), nullptr, nullptr);
    };
    Eigen::Matrix<double, 2, 6> J_pose;
    Eigen::Matrix<double, 2, 3> J_landmark;
    reprojectionError(q.toRotationMatrix(), p, camera, bearing, tangent, p_landmark, &J_pose, &J_landmark);
    const Eigen::Matrix<double, 2, 9> numeric = numericJacobian<2, 9>(error, 1e-5);
    // Differences of a smooth function with values up to 450: the step's square, and rounding over the step.
    EXPECT_LT((J_pose - numeric.leftCols<6>()).norm(), 1e-6 * (1.0 + numeric.norm()));
    EXPECT_LT((J_landmark - numeric.rightCols<3>()).norm(), 1e-6 * (1.0 + numeric.norm()));
    ++checked;
  }
  EXPECT_GT(checked, 150);
}

TEST(ReprojectionError, IsLargeAndFlatForWhatIsBehindOrNotFinite)
{
  const CameraGeometry camera;
  const Eigen::Vector3d bearing = Eigen::Vector3d::UnitZ();
  const Eigen::Matrix<double, 2, 3> tangent = tangentBasis(bearing) * 450.0;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Eigen::Vector3d& p_landmark :
       {Eigen::Vector3d(0, 0, -3), Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(nan, 0, 3), Eigen::Vector3d(1e300, 0, 0)})
  {
    Eigen::Matrix<double, 2, 6> J_pose;
    Eigen::Matrix<double, 2, 3> J_landmark;
    const Eigen::Vector2d error = reprojectionError(Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero(), camera,
                                                    bearing, tangent, p_landmark, &J_pose, &J_landmark);
    EXPECT_EQ(error, Eigen::Vector2d::Constant(1000.0)) << p_landmark.transpose();
    EXPECT_TRUE(J_pose.isZero());
    EXPECT_TRUE(J_landmark.isZero());
  }
  const Eigen::Vector3d no_bearing = Eigen::Vector3d::Constant(nan);
  EXPECT_EQ(reprojectionError(Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero(), camera, no_bearing,
                              tangentBasis(no_bearing), Eigen::Vector3d(0, 0, 3), nullptr, nullptr),
            Eigen::Vector2d::Constant(1000.0));
}

TEST(StateLink, HasTheDerivativesThatDifferencesShow)
{
  Random random(3);
  const ImuModel model;
  for (int trial = 0; trial < 40; ++trial)
  {
    const NavState begin = random.state();
    // The integral was made with other biases than those of the state, and the end is not where it predicts.
    ImuBias bias = begin.bias;
    bias.gyro += random.vector(2e-3);
    bias.accel += random.vector(2e-2);
    const ImuPreintegration imu = livelyImu(model, bias, 0.5);
    NavState end = imu.predict(begin);
    Vector15d apart;
    apart << random.vector(0.1), random.vector(0.1), random.vector(0.2), random.vector(1e-3), random.vector(1e-2);
    end.boxPlus(apart);
    for (bool still : {false, true})
    {
      const StateLink link(imu, model, still);
      const auto error = [&](const Eigen::Matrix<double, 30, 1>& delta) -> Vector15d
      {
        NavState moved_begin = begin;
        NavState moved_end = end;
        moved_begin.boxPlus(delta.head<15>());
        moved_end.boxPlus(delta.tail<15>());
        return link.error(moved_begin, moved_end, nullptr);
      };
      Eigen::Matrix<double, 15, 30> J;
      const Vector15d value = link.error(begin, end, &J);
      EXPECT_LT((value - error(Eigen::Matrix<double, 30, 1>::Zero())).norm(), 1e-9 * value.norm());
      const Eigen::Matrix<double, 15, 30> numeric = numericJacobian<15, 30>(error, 1e-6);
      for (int column = 0; column < 30; ++column)
      {
        // Whitened errors reach 1e5; a millionth of a column's size is the rounding of that over the step.
        EXPECT_LT((J.col(column) - numeric.col(column)).norm(), 2e-6 * (value.norm() + numeric.col(column).norm()))
            << (still ? "still" : "moving") << ", column " << column;
      }
    }
  }
}

TEST(WheelTie, IsZeroForTheWayDrivenAndHasTheDerivativesThatDifferencesShow)
{
  Random random(8);
  for (int trial = 0; trial < 20; ++trial)
  {
    WheelOptions options;
    options.T_body_wheels.linear() = expSo3(random.vector(1.0)).toRotationMatrix();
    options.T_body_wheels.translation() = random.vector(1.0);
    const NavState begin = random.state();
    const NavState end = random.state();
    const Eigen::Isometry3d T_begin_end = begin.T_odom_body().inverse() * end.T_odom_body();
    const Eigen::Vector3d lever = options.T_body_wheels.translation();
    WheelWay way;
    way.moved = (T_begin_end * lever - lever) / 0.98;
    way.length = way.moved.norm();
    way.duration = 0.5;
    const WheelTie tie(way, options, {0.98, 0.01});
    Eigen::Matrix<double, 3, 30> J;
    EXPECT_LT(tie.error(begin, end, &J).norm(), 1e-9);
    const Eigen::Matrix<double, 3, 30> numeric = numericJacobian<3, 30>(
        [&](const Eigen::Matrix<double, 30, 1>& delta) -> Eigen::Vector3d
        {
          NavState moved_begin = begin;
          NavState moved_end = end;
          moved_begin.boxPlus(delta.head<15>());
          moved_end.boxPlus(delta.tail<15>());
          Eigen::Matrix<double, 3, 30> unused;
          return tie.error(moved_begin, moved_end, &unused);
        },
        1e-6);
    EXPECT_LT((J - numeric).norm(), 1e-5 * J.norm());
  }
}

TEST(StateLink, IsZeroForThePredictedState)
{
  Random random(4);
  const ImuModel model;
  const NavState begin = random.state();
  const ImuPreintegration imu = livelyImu(model, begin.bias, 0.5);
  EXPECT_LT(StateLink(imu, model, false).error(begin, imu.predict(begin), nullptr).norm(), 1e-4);

  NavState end = begin;
  end.v.setZero();
  EXPECT_LT(StateLink(imu, model, true).error(begin, end, nullptr).norm(), 1e-12);
}

TEST(StateLink, HoldsPoseAndSpeedWhenStill)
{
  Random random(5);
  const ImuModel model;
  NavState begin = random.state();
  begin.v.setZero();
  const StateLink link(livelyImu(model, begin.bias, 0.5), model, true);
  for (int error = 0; error < 3; ++error)
  {
    NavState end = begin;
    Vector15d moved = Vector15d::Zero();
    moved(3 * error) = 0.01;
    end.boxPlus(moved);
    // A centimetre, a hundredth of a radian, a centimetre per second: each is far from still.
    EXPECT_GT(link.error(begin, end, nullptr).norm(), 1.5);
  }
}

TEST(StateLink, WhitensTheErrorsOfASimulatedImu)
{
  // The truth is what the noise-free IMU predicts; the error of a link of noisy samples must be white.
  ImuModel model;
  model.gyro_random_walk = 1e-3;  // so strong that its part of the error shows
  model.accel_random_walk = 3e-2;
  Random random(6);
  NavState begin = random.state();
  constexpr int RUNS = 3000;
  constexpr int SAMPLES = 100;
  constexpr int64_t STEP_NS = 5000000;
  const double dt = 1e-9 * static_cast<double>(STEP_NS);
  const auto motion = [](int i)
  {
    ImuSample sample;
    sample.stamp_ns = i * STEP_NS;
    const double t = 0.005 * i;
    sample.w = Eigen::Vector3d(0.6 * std::sin(3.0 * t), 0.4, 0.8);
    sample.f = Eigen::Vector3d(1.5 * std::cos(4.0 * t), -0.8, 9.81);
    return sample;
  };
  ImuPreintegration ideal(model, ImuBias());
  for (int i = 0; i < SAMPLES; ++i)
  {
    ideal.append(motion(i), motion(i + 1));
  }
  NavState start = begin;
  start.bias = ImuBias();
  const NavState truth = ideal.predict(start);

  Matrix15d covariance = Matrix15d::Zero();
  Vector15d mean = Vector15d::Zero();
  for (int run = 0; run < RUNS; ++run)
  {
    ImuBias bias = begin.bias;
    ImuPreintegration imu(model, begin.bias);
    const auto measured = [&](int i)
    {
      ImuSample sample = motion(i);
      sample.w += bias.gyro + random.vector(model.gyro_noise_density / std::sqrt(dt));
      sample.f += bias.accel + random.vector(model.accel_noise_density / std::sqrt(dt));
      return sample;
    };
    ImuSample last = measured(0);
    for (int i = 1; i <= SAMPLES; ++i)
    {
      bias.gyro += random.vector(model.gyro_random_walk * std::sqrt(dt));
      bias.accel += random.vector(model.accel_random_walk * std::sqrt(dt));
      const ImuSample next = measured(i);
      imu.append(last, next);
      last = next;
    }
    NavState end = truth;
    end.bias = bias;
    const Vector15d error = StateLink(imu, model, false).error(begin, end, nullptr);
    covariance += error * error.transpose() / RUNS;
    mean += error / RUNS;
  }
  // 3000 runs estimate variances to 2.6 % and correlations to 1.8 % (one deviation); four deviations, and a few percent
  // for the midpoint rule, which shares a sample's noise between two intervals.
  EXPECT_LT((covariance.diagonal() - Vector15d::Ones()).cwiseAbs().maxCoeff(), 0.14) << covariance.diagonal();
  Matrix15d correlation = covariance;
  correlation.diagonal().setZero();
  EXPECT_LT(correlation.cwiseAbs().maxCoeff(), 0.1) << correlation;
  EXPECT_LT(mean.cwiseAbs().maxCoeff(), 0.08) << mean;
}

TEST(StateLink, IsIntegratedAgainOnlyFarFromItsBias)
{
  const ImuModel model;
  const ImuBias bias;
  StateLink link(livelyImu(model, bias, 0.5), model, false);
  ImuBias near = bias;
  near.gyro.x() += 1e-3;
  link.relinearize(near);
  EXPECT_EQ(link.imu().bias().gyro, bias.gyro);
  ImuBias far = bias;
  far.gyro.x() += 0.05;
  link.relinearize(far);
  EXPECT_EQ(link.imu().bias().gyro, far.gyro);

  // A state predicted with that bias from scratch agrees, which first order would not.
  NavState begin;
  begin.bias = far;
  const NavState end = livelyImu(model, far, 0.5).predict(begin);
  EXPECT_LT(link.error(begin, end, nullptr).norm(), 1e-6);
  const StateLink first_order(livelyImu(model, bias, 0.5), model, false);
  EXPECT_GT(first_order.error(begin, end, nullptr).norm(), 1e-3);
}
