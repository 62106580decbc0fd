#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_slam/so3.h>
#include "inertial/wheels.h"

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

#include "inertial/start_ns.h"

using namespace pi_slam;
using pi_node::test_support::messageOf;

namespace
{

int64_t stampAt(double time_s)
{
  return START_NS + std::llround(1e9 * time_s);
}

WheelSample sampleAt(double time_s, double speed, double yaw_rate = 0.0)
{
  WheelSample sample;
  sample.stamp_ns = stampAt(time_s);
  sample.v.x() = speed;
  sample.yaw_rate = yaw_rate;
  return sample;
}

/// 0.3 m behind the IMU and 0.8 m below it, which is turned by 90 degrees.
WheelOptions mounted()
{
  WheelOptions options;
  options.T_body_wheels.linear() = Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  options.T_body_wheels.translation() = Eigen::Vector3d(0.1, -0.3, -0.8);
  return options;
}

NavState someState()
{
  NavState state;
  state.q = expSo3(Eigen::Vector3d(0.05, -0.02, 0.7));
  state.bias.gyro = Eigen::Vector3d(0.01, -0.02, 0.03);
  return state;
}

const Eigen::Vector3d TURN(0.05, -0.1, 0.6);  // [rad/s]

/// The state whose wheels roll at 2 m/s while it turns.
NavState rolling(const WheelOptions& options)
{
  NavState state = someState();
  state.v = state.q * (options.T_body_wheels.linear() * Eigen::Vector3d(2.0, 0.0, 0.0) -
                       TURN.cross(options.T_body_wheels.translation()));
  return state;
}

}  // namespace

TEST(WheelScale, ThatIsFarFromOneIsNamed)
{
  EXPECT_EQ("", scaleComplaint({1.0, 0.001}));
  EXPECT_EQ("", scaleComplaint({0.99, 0.001})) << "a matter of tyres";
  EXPECT_EQ("", scaleComplaint({1.03, 0.01})) << "not known well yet";
  EXPECT_EQ(
      "the cameras measure 2.0 % less way than the wheels; check the cameras' baseline in the calibration, and the "
      "wheels' radius",
      scaleComplaint({0.98, 0.002}));
  EXPECT_NE(std::string::npos, scaleComplaint({1.1, 0.002}).find("10.0 % more way"));
}

TEST(WheelBuffer, GivesMeansBetweenAnyTwoTimes)
{
  WheelBuffer wheels;
  EXPECT_FALSE(wheels.mean(stampAt(0.0), stampAt(0.1)));
  for (int i = 0; i <= 20; ++i)
  {
    EXPECT_TRUE(wheels.add(sampleAt(0.02 * i, 0.5 * 0.02 * i, 0.1)));  // 0.5 m/s^2
  }
  for (const double from : {0.0, 0.013, 0.04})
  {
    for (const double length : {0.005, 0.02, 0.05, 0.3})
    {
      const std::optional<WheelSample> mean = wheels.mean(stampAt(from), stampAt(from + length));
      ASSERT_TRUE(mean);
      EXPECT_NEAR(mean->v.x(), 0.5 * (from + 0.5 * length), 1e-6) << from << " + " << length;
      EXPECT_NEAR(mean->yaw_rate, 0.1, 1e-9);
    }
  }
  // The newest holds for a tenth of a second; before the first nothing is known.
  EXPECT_NEAR(wheels.mean(stampAt(0.40), stampAt(0.48))->v.x(), 0.2, 1e-9);
  EXPECT_FALSE(wheels.mean(stampAt(0.40), stampAt(0.52)));
  EXPECT_FALSE(wheels.mean(stampAt(-0.01), stampAt(0.1)));
  EXPECT_FALSE(wheels.add(sampleAt(0.4, 1.0)));
  EXPECT_FALSE(wheels.add(sampleAt(0.5, std::nan(""))));
  // The clock is set back.
  WheelBuffer again = wheels;
  EXPECT_TRUE(again.add(sampleAt(-10.0, 1.0)));
  EXPECT_TRUE(again.mean(stampAt(-10.0), stampAt(-9.95)));
  // A hole in them.
  EXPECT_TRUE(wheels.add(sampleAt(0.9, 1.0)));
  EXPECT_FALSE(wheels.mean(stampAt(0.3), stampAt(0.9)));
  wheels.forgetBefore(stampAt(0.2));
  EXPECT_FALSE(wheels.mean(stampAt(0.1), stampAt(0.3)));
  EXPECT_TRUE(wheels.mean(stampAt(0.2), stampAt(0.3)));
}

TEST(WheelBuffer, TellsRestMotionAndNeither)
{
  const auto told = [](double speed, double yaw_rate)
  {
    WheelBuffer wheels;
    for (int i = 0; i <= 20; ++i)
    {
      wheels.add(sampleAt(0.02 * i, speed, yaw_rate));
    }
    return wheels.atRest(stampAt(0.0), stampAt(0.4));
  };
  EXPECT_EQ(told(0.0, 0.0), std::optional(true));
  EXPECT_EQ(told(0.02, 0.0), std::optional(false));
  EXPECT_EQ(told(0.004, 0.0), std::nullopt);
  EXPECT_EQ(told(0.0, 0.05), std::nullopt);
  EXPECT_EQ(WheelBuffer().atRest(stampAt(0.0), stampAt(0.4)), std::nullopt);
}

TEST(CorrectByWheels, HasNoErrorWhereTheStateRolls)
{
  const WheelOptions options = mounted();
  NavState state = rolling(options);
  const NavState before = state;
  Matrix15d covariance = 0.01 * Matrix15d::Identity();
  double residual = 1.0;
  EXPECT_EQ(correctByWheels(sampleAt(0.0, 2.0 / 0.97), options, {0.97, 0.01}, state.v, TURN, state.q, &state,
                            &covariance, &residual),
            WheelVerdict::USED);
  EXPECT_NEAR(residual, 0.0, 1e-9);
  EXPECT_LT(state.boxMinus(before).norm(), 1e-9);
  const double left = covariance.block<3, 3>(6, 6).trace();
  EXPECT_LT(left, 0.029);
}

/// With an error in one direction of the state alone, the correction takes it back.
TEST(CorrectByWheels, HasTheDerivativesThatDifferencesShow)
{
  const WheelOptions options = mounted();
  for (int i = 3; i < 12; ++i)
  {
    Vector15d off = Vector15d::Zero();
    off[i] = 1e-3;
    NavState state = rolling(options);
    const NavState truth = state;
    state.boxPlus(off);
    Matrix15d covariance = 1e-12 * Matrix15d::Identity();
    covariance(i, i) = 1e6;
    // A rate that is too small by the bias that is too large.
    const Eigen::Vector3d w = TURN - (state.bias.gyro - truth.bias.gyro);
    correctByWheels(sampleAt(0.0, 2.0), options, {1.0, 1e-3}, state.v, w, state.q, &state, &covariance, nullptr);
    const Vector15d left = state.boxMinus(truth);
    // The roll of a vehicle that rolls straight is not seen in its speed.
    const bool seen = covariance(i, i) < 1.0;
    EXPECT_TRUE(seen || (i >= 3 && i < 6)) << i;
    EXPECT_LT(std::abs(left[i]), seen ? 2e-5 : 1.1e-3) << i;
  }
}

TEST(CorrectByWheels, RefusesSlipAndSkid)
{
  const WheelOptions options = mounted();
  const NavState truth = rolling(options);
  for (const Eigen::Vector2d& said : {Eigen::Vector2d(2.6, 0.0), Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(2.0, 0.5)})
  {
    NavState state = truth;
    Matrix15d covariance = 1e-4 * Matrix15d::Identity();
    WheelSample sample = sampleAt(0.0, said.x());
    sample.v = said;
    EXPECT_EQ(correctByWheels(sample, options, {1.0, 0.01}, state.v, TURN, state.q, &state, &covariance, nullptr),
              WheelVerdict::REFUSED);
    EXPECT_EQ(state.v, truth.v);
  }
}

namespace
{

/// Drives 40 m through curves with wheels that say what `spoil` makes of the truth.
WheelMonitor monitored(const WheelOptions& options, const std::function<void(WheelSample*)>& spoil)
{
  WheelMonitor monitor(options);
  constexpr double DT = 0.05;
  NavState state;
  for (int i = 0; i < 400; ++i)
  {
    const double yaw_rate = 0.4 * std::sin(0.2 * DT * i);
    const Eigen::Vector3d w = options.T_body_wheels.linear() * Eigen::Vector3d(0.0, 0.0, yaw_rate);
    NavState next = state;
    next.q = state.q * expSo3(DT * w);
    // The wheels' origin rolls forward, the body's turns about it.
    const Eigen::Vector3d lever = options.T_body_wheels.translation();
    const Eigen::Quaterniond middle = state.q * expSo3(0.5 * DT * w);
    next.p = state.p + state.q * lever - next.q * lever +
             DT * (middle * (options.T_body_wheels.linear() * Eigen::Vector3d(2.0, 0.0, 0.0)));
    WheelSample sample = sampleAt(DT * i, 2.0, yaw_rate);
    spoil(&sample);
    WheelWay way;
    way.duration = DT;
    way.moved = DT * (expSo3(0.5 * DT * w) *
                      (options.T_body_wheels.linear() * Eigen::Vector3d(sample.v.x(), sample.v.y(), 0.0)));
    way.length = way.moved.norm();
    state = next;
    monitor.add(state, way, DT * sample.yaw_rate, DT * yaw_rate);
  }
  return monitor;
}

}  // namespace

TEST(WheelMonitor, FindsTheScale)
{
  const WheelMonitor monitor = monitored(mounted(), [](WheelSample* sample) { sample->v *= 1.03; });
  EXPECT_NEAR(monitor.scale().value, 1.0 / 1.03, 1e-3);
  EXPECT_LT(monitor.scale().deviation, 3e-3);
  EXPECT_EQ(monitor.fault(), "");
}

TEST(WheelMonitor, NamesWhatIsWrong)
{
  const auto fault = [](const std::function<void(WheelSample*)>& spoil) { return monitored(mounted(), spoil).fault(); };
  const auto says = [](const std::string& text, const std::string& part)
  { return text.find(part) != std::string::npos; };
  EXPECT_PRED2(says, fault([](WheelSample* sample) { sample->v *= -1.0; }), "the sign of linear.x is wrong");
  EXPECT_PRED2(says, fault([](WheelSample* sample) { sample->yaw_rate *= -1.0; }), "the sign of angular.z is wrong");
  EXPECT_PRED2(says, fault([](WheelSample* sample) { sample->v *= 3.6; }), "wrong by a factor of 0.278");
  EXPECT_PRED2(says, fault([](WheelSample* sample) { sample->v = {0.0, sample->v.x()}; }), "the frame is wrong");
  EXPECT_PRED2(says, fault([](WheelSample* sample) { sample->v.setZero(); }), "give nothing");
}

TEST(WheelOptions, NameFieldValueAndBound)
{
  WheelOptions options;
  options.scale_deviation = 0.5;
  EXPECT_EQ(messageOf<std::invalid_argument>([&] { options.validate(); }),
            "wheels/scale_deviation = 0.5, must be in [0.001, 0.3]");
}
