#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "inertial/start_ns.h"
#include "inertial/vibration_meter.h"

using namespace pi_slam;

namespace
{

/// Two seconds with the noise of the sensor; the last sample. @param shake  [m/s^2] at 33 Hz.
ImuSample lastOf(VibrationMeter* meter, double shake, double sway = 0.0)
{
  const ImuModel model;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0.0, model.accel_noise_density * std::sqrt(model.rate_hz));
  ImuSample sample;
  for (int i = 0; i < 400; ++i)
  {
    const double t = 0.005 * i;
    sample =
        ImuSample{START_NS + 5000000LL * i, Eigen::Vector3d::Zero(),
                  Eigen::Vector3d{noise(random) + sway * std::sin(2.0 * M_PI * 2.0 * t), noise(random),
                                  9.81 + noise(random) + shake * std::sqrt(2.0) * std::sin(2.0 * M_PI * 33.0 * t)}};
    meter->add(&sample);
  }
  return sample;
}

}  // namespace

TEST(VibrationMeter, TakesNoiseAndMotionForWhatTheyAre)
{
  VibrationMeter meter{ImuModel()};
  EXPECT_EQ(lastOf(&meter, 0.0).f_shake, 0.0F);
  EXPECT_EQ(lastOf(&meter, 0.0, 3.0).f_shake, 0.0F);
  EXPECT_EQ(meter.message(), "");
}

TEST(VibrationMeter, MeasuresWhatShakesFaster)
{
  VibrationMeter meter{ImuModel()};
  // The second difference sees 0.44 of the amplitude of 33 Hz.
  EXPECT_NEAR(lastOf(&meter, 1.0).f_shake * std::sqrt(200.0), 0.44, 0.1);
  EXPECT_EQ(meter.message(), "");
  lastOf(&meter, 4.0);
  EXPECT_NE(meter.message().find("imu/data: shakes with 1."), std::string::npos) << meter.message();
  lastOf(&meter, 10.0);
  EXPECT_NE(meter.message().find("the pose comes from pictures and wheels"), std::string::npos) << meter.message();
}

TEST(VibrationMeter, StartsAnewAfterAGap)
{
  VibrationMeter meter{ImuModel()};
  const ImuSample last = lastOf(&meter, 0.0);
  ImuSample far = last;
  far.stamp_ns += 500000000LL;
  far.f.x() += 50.0;
  meter.add(&far);
  EXPECT_EQ(far.f_shake, 0.0F);
}
