// The vehicle in its world, on a pseudo-terminal, with time as the test gives it.

#include "vehicle/vehicle_simulation.h"

#include <gtest/gtest.h>
#include <pi_vehicle/chassis/chassis_host.h>
#include <pi_vehicle/serial/serial_port.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_simulation
{
namespace
{

constexpr int64_t START_NS = 1'700'000'000'000'000'000;
constexpr int64_t SECOND_NS = 1'000'000'000;
constexpr int64_t TICK_NS = 5'000'000;

const std::string SCENARIO = R"(
name: test
road: [[0, 0], [120, 0]]
parked: false
start: [5, 0, 0]
goal: [100, 0, 0]
actors:
  - {id: wall, class: box, path: [[25, 0]], size: [1, 2, 1]}
  - {id: child, class: person, path: [[60, -4], [60, 4]], trigger: {near: [60, 0], within: 52}}
  - {id: called, class: person, path: [[70, -4], [70, 4]], trigger: {command: true}}
faults:
  - {time: 1.0, command: imu off, for: 0.5, end: imu on}
  - {time: 2.0, command: camera left dark}
)";

/// A simulation with a host at the other end of its line.
class Drive
{
public:
  explicit Drive(const std::string& scenario = SCENARIO, VehicleSimulationOptions options = VehicleSimulationOptions())
    : simulation(Scenario::parse(scenario, "test", 1), options, outputs(), START_NS)
    , host(pi_vehicle::chassis::HostOptions())
    , port(simulation.chassis().path(), 115200, "the chassis")
    , now_ns(START_NS)
  {
    host.onLineOpen(now_ns);
  }

  /// Goes on while the host commands this motion.
  void run(double seconds, double speed, double curvature = 0.0)
  {
    const int64_t end_ns = now_ns + static_cast<int64_t>(seconds * 1e9);
    while (now_ns < end_ns)
    {
      host.setMotion({speed, curvature, 0.0}, now_ns);
      const std::vector<uint8_t> output = host.poll(now_ns);
      port.write(output.data(), output.size());
      for (int i = 0; i < 4; ++i)
      {
        now_ns += TICK_NS;
        simulation.advance(now_ns);
      }
      std::array<uint8_t, 4096> bytes;
      host.onBytes(bytes.data(), port.read(bytes.data(), bytes.size()), now_ns);
    }
  }

  bool logged(const std::string& part) const { return !lineWith(part).empty(); }
  std::string lineWith(const std::string& part) const
  {
    for (const std::string& line : log)
    {
      if (line.find(part) != std::string::npos)
      {
        return line;
      }
    }
    return "";
  }

  std::vector<pi_slam::ImuSample> imu;
  std::vector<Exposure> exposures;
  std::vector<TruePose> poses;
  std::vector<TrueObstacle> obstacles;
  std::vector<std::string> log;
  std::vector<std::string> collisions;
  VehicleSimulation simulation;
  pi_vehicle::chassis::ChassisHost host;
  pi_vehicle::SerialPort port;
  int64_t now_ns;

private:
  SimulationOutputs outputs()
  {
    SimulationOutputs all;
    all.imu = [this](const pi_slam::ImuSample& sample) { imu.push_back(sample); };
    all.exposure = [this](const Exposure& exposure) { exposures.push_back(exposure); };
    all.pose = [this](const TruePose& pose) { poses.push_back(pose); };
    all.obstacles = [this](int64_t, const std::vector<TrueObstacle>& now) { obstacles = now; };
    all.collision = [this](const std::string& with) { collisions.push_back(with); };
    all.log = [this](const std::string& line) { log.push_back(line); };
    return all;
  }
};

VehicleSimulationOptions idealImu()
{
  VehicleSimulationOptions options;
  options.imu = pi_slam::ImuSimulatorOptions::makeIdeal();
  return options;
}

TEST(VehicleSimulation, GivesEverythingAtItsRate)
{
  Drive drive;
  drive.run(0.9, 0.0);
  EXPECT_NEAR(180.0, static_cast<double>(drive.imu.size()), 3.0);
  EXPECT_NEAR(18.0, static_cast<double>(drive.exposures.size()), 1.0);
  EXPECT_NEAR(45.0, static_cast<double>(drive.poses.size()), 1.0);
  for (size_t i = 1; i < drive.imu.size(); ++i)
  {
    ASSERT_EQ(5'000'000, drive.imu[i].stamp_ns - drive.imu[i - 1].stamp_ns);
  }
  for (size_t i = 1; i < drive.exposures.size(); ++i)
  {
    ASSERT_EQ(50'000'000, drive.exposures[i].stamp_ns - drive.exposures[i - 1].stamp_ns);
  }
}

TEST(VehicleSimulation, TheMapBeginsAtTheImu)
{
  Drive drive;
  drive.run(0.1, 0.0);
  const Eigen::Vector3d p = drive.poses.back().T_map_base.translation();
  EXPECT_NEAR(-0.8, p.x(), 1e-6);
  EXPECT_NEAR(0.0, p.y(), 1e-6);
  EXPECT_NEAR(-1.0, p.z(), 0.02);  // bumps
}

TEST(VehicleSimulation, DrivesOverTheSerialLine)
{
  Drive drive;
  drive.run(5.0, 1.0);
  const TruePose& pose = drive.poses.back();
  EXPECT_GT(pose.T_map_base.translation().x(), 3.0);
  EXPECT_NEAR(1.0, pose.velocity.x(), 0.02);
  EXPECT_NEAR(drive.host.state(drive.now_ns).odometry.distance, pose.T_map_base.translation().x() + 0.8, 0.05);
}

TEST(VehicleSimulation, IntegratedImuGivesTheMotionBack)
{
  Drive drive(SCENARIO.substr(0, SCENARIO.find("faults")), idealImu());
  drive.run(0.5, 0.0);
  drive.imu.clear();
  drive.poses.clear();
  drive.run(8.0, 1.5, 0.1);
  ASSERT_GT(drive.imu.size(), 1500u);
  // At rest at the beginning, so attitude and place are those of the first true pose.
  const Eigen::Vector3d lever(0.8, 0.0, 1.0);
  const TruePose& first = drive.poses.front();
  Eigen::Matrix3d R = first.T_map_base.linear();
  Eigen::Vector3d p = first.T_map_base * lever;
  Eigen::Vector3d v = Eigen::Vector3d::Zero();
  const TruePose& last = drive.poses.back();
  for (size_t i = 1; i < drive.imu.size(); ++i)
  {
    const pi_slam::ImuSample& a = drive.imu[i - 1];
    const pi_slam::ImuSample& b = drive.imu[i];
    if (a.stamp_ns < first.stamp_ns || b.stamp_ns > last.stamp_ns)
    {
      continue;
    }
    const double dt = 1e-9 * static_cast<double>(b.stamp_ns - a.stamp_ns);
    const Eigen::Vector3d turn = 0.5 * dt * (a.w + b.w);
    const Eigen::Matrix3d next =
        R * Eigen::AngleAxisd(turn.norm(), turn.norm() > 0.0 ? Eigen::Vector3d(turn.normalized())
                                                             : Eigen::Vector3d(Eigen::Vector3d::UnitX()))
                .toRotationMatrix();
    const Eigen::Vector3d acceleration = 0.5 * (R * a.f + next * b.f) - Eigen::Vector3d(0.0, 0.0, 9.81);
    p += v * dt + 0.5 * acceleration * dt * dt;
    v += acceleration * dt;
    R = next;
  }
  EXPECT_LT((p - last.T_map_base * lever).norm(), 0.05) << "of " << last.T_map_base.translation().norm() << " m";
  EXPECT_LT(Eigen::AngleAxisd(Eigen::Matrix3d(R.transpose() * last.T_map_base.linear())).angle(), 2e-3);
}

TEST(VehicleSimulation, JudgesDistanceAndCollision)
{
  Drive drive;
  drive.run(0.2, 0.0);
  // From the front at 5 + 1 m to the near side of the box at 24.5 m.
  const auto wall = std::find_if(drive.obstacles.begin(), drive.obstacles.end(),
                                 [](const TrueObstacle& one) { return one.name == "wall"; });
  ASSERT_NE(drive.obstacles.end(), wall);
  EXPECT_NEAR(18.5, wall->distance, 0.01);
  EXPECT_NEAR(20.0, wall->box.center.x(), 0.01);
  // Houses beside the road are there too, nearest first.
  for (size_t i = 1; i < drive.obstacles.size(); ++i)
  {
    EXPECT_LE(drive.obstacles[i - 1].distance, drive.obstacles[i].distance);
  }
  EXPECT_FALSE(drive.logged("\"collision\""));
  EXPECT_EQ("", drive.simulation.command("pose 20 0 0"));
  drive.run(4.0, 1.5);
  EXPECT_EQ(1u, drive.simulation.collisions());
  EXPECT_EQ(std::vector<std::string>{"wall"}, drive.collisions);
  const std::string line = drive.lineWith("\"collision\"");
  EXPECT_NE(std::string::npos, line.find("\"actor\":\"wall\",\"class\":\"box\"")) << line;
}

TEST(VehicleSimulation, ActorsGoWhenTheVehicleComes)
{
  Drive drive;
  drive.run(1.0, 0.0);
  EXPECT_FALSE(drive.logged("\"actor\":\"child\"}"));
  EXPECT_EQ("", drive.simulation.command("pose 30 0 0"));
  drive.run(3.0, 0.5);
  EXPECT_TRUE(drive.logged("\"trigger\",\"actor\":\"child\""));
  EXPECT_GT(drive.exposures.back().actors.at(1).position.y(), -3.0);
  EXPECT_EQ(-4.0, drive.exposures.back().actors.at(2).position.y());
  EXPECT_EQ("", drive.simulation.command("actor called go"));
  drive.run(1.0, 0.0);
  EXPECT_GT(drive.exposures.back().actors.at(2).position.y(), -4.0);
}

TEST(VehicleSimulation, FaultsComeAtTheirTimes)
{
  Drive drive;
  drive.run(2.5, 0.0);
  double longest = 0.0;
  for (size_t i = 1; i < drive.imu.size(); ++i)
  {
    longest = std::max(longest, 1e-9 * static_cast<double>(drive.imu[i].stamp_ns - drive.imu[i - 1].stamp_ns));
  }
  EXPECT_NEAR(0.5, longest, 0.011);
  EXPECT_EQ(CameraState::DARK, drive.exposures.back().left);
  EXPECT_EQ(CameraState::ON, drive.exposures.back().right);
  EXPECT_EQ(CameraState::ON, drive.exposures.front().left);
  EXPECT_TRUE(drive.logged("\"command\",\"line\":\"imu off\""));
}

TEST(VehicleSimulation, CommandsThatMeanNothingAreRefusedWithTheGoodOnes)
{
  Drive drive;
  for (const char* line : {"", "camera", "camera middle off", "camera left upside", "imu", "dance"})
  {
    const std::string problem = drive.simulation.command(line);
    EXPECT_NE(std::string::npos, problem.find("must be one of")) << problem;
    EXPECT_NE(std::string::npos, problem.find("camera left|right|both on|off|dark")) << problem;
  }
  EXPECT_EQ("command \"actor nobody go\": there is no actor nobody, must be one of: wall, child, called",
            drive.simulation.command("actor nobody go"));
}

TEST(VehicleSimulation, RefusesImpossibleOptions)
{
  VehicleSimulationOptions options;
  options.footprint.half_width = 0.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

}  // namespace
}  // namespace pi_simulation
