// Odometry with wheels, on rendered drives. The wheels say 2 % too much, with 1 % of noise.
#include "vio_drive.h"

namespace pi_slam
{
namespace
{

double tiltOf(const NavState& state)
{
  return std::acos(std::min(1.0, (state.q * Eigen::Vector3d::UnitZ()).z())) * 180.0 / M_PI;
}

/// How far off a motion between two outcomes is: position in the frame of the first [m], heading [degrees].
std::pair<double, double> offBetween(const Drive& drive, const Outcome& from, const Outcome& to)
{
  const Eigen::Isometry3d was = drive.trajectory.at(from.report.stamp_ns).T_world_body;
  const Eigen::Isometry3d is = drive.trajectory.at(to.report.stamp_ns).T_world_body;
  const Eigen::Isometry3d off =
      (was.inverse() * is).inverse() * (from.state.T_odom_body().inverse() * to.state.T_odom_body());
  return {off.translation().norm(), std::abs(std::atan2(off.linear()(1, 0), off.linear()(0, 0))) * 180.0 / M_PI};
}

struct WheelsTest : VioTest
{
  void useWheels(const Drive& drive, const std::vector<WheelSimulatorOptions::Slip>& slips = {}, double scale = 1.02)
  {
    WheelSimulatorOptions options;
    options.scale = scale;
    options.slips = slips;
    wheels_ = simulateWheels(drive.trajectory, options);
    aligned_ = false;
    messages_.clear();
  }
};

/// Black pictures for 20 s and for 60 s at 3 m/s through curves, with wheels that spin and lock meanwhile.
TEST_F(WheelsTest, ReckonsInTheDarkByWheels)
{
  constexpr double DARK_S = 16.0;
  for (const double length_s : {20.0, 60.0})
  {
    VehiclePathOptions path;
    path.shape = PathShape::CAMPUS_LOOP;
    path.duration_s = DARK_S + length_s + 4.0;
    const Drive drive(makeVehiclePath(path), 5, WorldKind::CAMPUS, DARK_S, DARK_S + length_s);
    useWheels(drive, {{DARK_S + 3.0, DARK_S + 3.8, 1.5}, {DARK_S + 12.0, DARK_S + 12.5, 0.0}});
    Vio vio(drive.calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, Faults(), drive);
    const Outcome& before = at(outcomes, DARK_S - 0.1);
    const Outcome& end = at(outcomes, DARK_S + length_s - 0.1);
    ASSERT_TRUE(before.known) << allMessages();
    EXPECT_NE("", scaleComplaint(end.report.wheels.scale)) << "2 % are named";
    EXPECT_EQ(end.report.status, VioStatus::BLIND);
    EXPECT_GE(end.report.wheels.slips, 2u);
    EXPECT_TRUE(said("by IMU and wheels")) << allMessages();
    const double bound = length_s > 30.0 ? 0.02 : 0.01;
    for (const Outcome* const outcome : {&end, &outcomes.back()})
    {
      const auto [off_m, off_deg] = offBetween(drive, before, *outcome);
      EXPECT_LT(off_m, bound * 3.0 * length_s) << outcome->time_s << " s of " << length_s;
      EXPECT_LT(off_deg, length_s / 10.0);
      EXPECT_LT(off_m, 4.0 * deviation(*outcome));
      RecordProperty("off_mm_" + std::to_string(static_cast<int>(length_s)), static_cast<int>(1e3 * off_m));
      std::cout << length_s << " s of darkness: " << off_m << " m, " << off_deg << " degrees off at " << outcome->time_s
                << " s, deviation " << deviation(*outcome) << " m, scale " << outcome->report.wheels.scale.value
                << " +- " << outcome->report.wheels.scale.deviation << "\n";
    }
    EXPECT_LT(correctedAfter(outcomes, DARK_S + length_s), DARK_S + length_s + 1.0);
    EXPECT_FALSE(std::any_of(outcomes.begin(), outcomes.end(), [](const Outcome& o) { return o.report.reset; }));
  }
}

/// Slipping wheels in the light do no harm, and are named.
TEST_F(WheelsTest, IsNotMisledBySlip)
{
  const Drive& drive = Drive::instance();
  useWheels(drive, {{4.0, 5.0, 1.4}, {8.0, 9.0, 0.0}});
  Vio vio(drive.calibration, makeOptions());
  const std::vector<Outcome> outcomes = run(&vio, Faults(), drive);
  EXPECT_TRUE(said("slip or skid")) << allMessages();
  EXPECT_EQ(outcomes.back().report.wheels.slips, 2u);
  EXPECT_NEAR(outcomes.back().report.wheels.scale.value, 1.0 / 1.02, 0.01);
  EXPECT_LT(outcomes.back().error_m, 0.15);
}

TEST_F(WheelsTest, NamesWheelsThatCannotBeUsed)
{
  struct Case
  {
    std::string text;
    std::function<void(WheelSample*)> spoil;
  };
  const Case cases[] = {
      {"sign of linear.x", [](WheelSample* sample) { sample->v *= -1.0; }},
      {"sign of angular.z", [](WheelSample* sample) { sample->yaw_rate *= -1.0; }},
      {"wrong by a factor of 0.2", [](WheelSample* sample) { sample->v *= 3.6; }},
      {"frame is wrong", [](WheelSample* sample) { std::swap(sample->v.x(), sample->v.y()); }},
      {"encoders or their driver", [](WheelSample* sample) { sample->v.setZero(); }},
  };
  const Drive& drive = Drive::instance();
  for (const Case& wrong : cases)
  {
    useWheels(drive);
    for (WheelSample& sample : wheels_)
    {
      wrong.spoil(&sample);
    }
    Vio vio(drive.calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, Faults(), drive);
    EXPECT_TRUE(said(wrong.text)) << wrong.text << " not in\n" << allMessages();
    EXPECT_FALSE(outcomes.back().report.wheels.used);
    EXPECT_LT(outcomes.back().error_m, 0.2) << wrong.text;
  }
}

/// At 2 cm/s, then at 4 cm/s, as without wheels.
TEST_F(WheelsTest, LosesNoWayWhenItCreeps)
{
  for (const WorldKind kind : {WorldKind::HALL, WorldKind::CAMPUS})
  {
    const Drive drive(creepingPath(), 2, kind);
    useWheels(drive);
    Vio vio(drive.calibration, makeOptions());
    const std::vector<Outcome> outcomes = run(&vio, Faults(), drive);
    ASSERT_EQ(at(outcomes, 3.5).report.status, VioStatus::STANDSTILL);
    EXPECT_EQ(outcomes.back().report.status, VioStatus::STANDSTILL);
    double most = 0.0;
    for (const Outcome& outcome : outcomes)
    {
      most = std::max(most, outcome.error_m);
    }
    EXPECT_LT(most, 0.02);
    std::cout << "creep: " << most << " m lost\n";
  }
}

TEST_F(WheelsTest, IsUprightWhenItHasSetOff)
{
  VehiclePathOptions path;
  path.shape = PathShape::STRAIGHT;
  path.duration_s = 20.0;
  path.start_standstill_s = 3.0;
  path.bumps = 0.0;
  const Drive drive(makeVehiclePath(path), 1, WorldKind::CAMPUS);
  useWheels(drive);
  Vio vio(drive.calibration, makeOptions());
  double most = 0.0;
  for (const Outcome& outcome : run(&vio, Faults(), drive))
  {
    most = outcome.known ? std::max(most, tiltOf(outcome.state)) : most;
  }
  EXPECT_GT(most, 0.0);
  EXPECT_LT(most, 0.5);
  std::cout << "tilt after driving off: " << most << " degrees\n";
}

/// Without pictures at all, not black ones: the propagation takes the wheels.
TEST_F(WheelsTest, PropagatesByWheelsWithoutPairs)
{
  const Drive& drive = Drive::instance();
  useWheels(drive);
  Vio vio(drive.calibration, makeOptions());
  double off_m = 0.0;
  size_t next_wheels = 0;
  size_t next_frame = 0;
  std::optional<Eigen::Isometry3d> T_world_odom;
  for (const ImuSample& sample : drive.imu)
  {
    const std::optional<PropagatedState> state = vio.addImu(sample);
    for (; next_wheels < wheels_.size() && wheels_[next_wheels].stamp_ns <= sample.stamp_ns; ++next_wheels)
    {
      vio.addWheels(wheels_[next_wheels]);
    }
    for (; next_frame < drive.frames.size() && drive.frames[next_frame].stamp_ns <= sample.stamp_ns; ++next_frame)
    {
      const StereoFrame& frame = drive.frames[next_frame];
      if (drive.seconds(frame.stamp_ns) < 5.0)
      {
        vio.addPair(frame.stamp_ns, frame.left, frame.right);
      }
    }
    if (state && drive.seconds(sample.stamp_ns) < 5.0)
    {
      T_world_odom = drive.trajectory.at(sample.stamp_ns).T_world_body * state->state.T_odom_body().inverse();
    }
    if (state && T_world_odom && drive.seconds(sample.stamp_ns) < 11.0)
    {
      off_m = ((*T_world_odom * state->state.T_odom_body()).translation() -
               drive.trajectory.at(sample.stamp_ns).T_world_body.translation())
                  .norm();
    }
  }
  EXPECT_GT(off_m, 0.0);
  EXPECT_LT(off_m, 0.25);  // of 9 m in 6 s, the scale hardly known yet; by IMU alone it is over a metre
  std::cout << "propagated for 6 s: " << off_m << " m off\n";
}

}  // namespace
}  // namespace pi_slam
