// Judge of vehicle_simulator.test.

#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_simulation/SimulatorCommand.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <string>

namespace pi_simulation
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
const std::string SCENARIO = R"(
name: test
road: [[0, 0], [60, 0]]
start: [10, 0, 0]
goal: [40, 0, 0]
actors:
  - {id: child, class: person, path: [[25, -4], [25, 4]], trigger: {command: true}}
)";

/// One simulator for all tests: a second one in the same manager can lose /clock there, where time would stand still,
/// as roscpp takes the late news that the first one's /clock is gone for news of the second.
class Simulator : public testing::Test
{
protected:
  static void SetUpTestSuite()
  {
    folder() = std::make_unique<TemporaryFolder>();
    const std::string link = folder()->path() + "/chassis";
    ros::param::set("/simulator/scenario", folder()->file("test.yaml", SCENARIO));
    ros::param::set("/simulator/link", link);
    ros::param::set("/simulator/log", folder()->path() + "/log.jsonl");
    ros::param::set("/vehicle/pictures/width", 320);
    ros::param::set("/vehicle/pictures/height", 240);
    ros::param::set("/simulator/diagnostic_period", 0.2);
    ros::param::set("/chassis/port", link);
    ros::param::set("/chassis/longest_pause_s", 0.2);
    ASSERT_TRUE(loadNodelet("/simulator", "pi_simulation/vehicle_simulator"));
    ASSERT_TRUE(loadNodelet("/chassis", "pi_vehicle/chassis"));
  }
  static void TearDownTestSuite()
  {
    EXPECT_TRUE(unloadNodelet("/chassis"));
    EXPECT_TRUE(unloadNodelet("/simulator"));
    folder().reset();
  }
  static std::unique_ptr<TemporaryFolder>& folder()
  {
    static std::unique_ptr<TemporaryFolder> folder;
    return folder;
  }

  void SetUp() override
  {
    commands_ = ros::NodeHandle().advertise<pi_vehicle::MotionCommand>("motion", 1);
    ASSERT_TRUE(states_.waitForPublisher());
    ASSERT_TRUE(truth_.waitForPublisher());
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return commands_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(until(
        TIMEOUT_S, [this]
        { return truth_.last() && states_.last() && states_.last()->mode != pi_vehicle::VehicleState::DISCONNECTED; }));
  }

  template <typename Condition>
  bool drivesUntil(double speed, Condition&& condition)
  {
    return until(2.0 * TIMEOUT_S,
                 [&]
                 {
                   pi_vehicle::MotionCommand message;
                   message.header.stamp = ros::Time::now();
                   message.speed = speed;
                   message.source = "test";
                   commands_.publish(message);
                   return condition();
                 });
  }
  static std::string command(const std::string& line)
  {
    SimulatorCommand call;
    call.request.line = line;
    return ros::service::waitForService("/simulator/command", ros::Duration(TIMEOUT_S)) &&
                   ros::service::call("/simulator/command", call)
               ? call.response.message
               : "no service";
  }
  double way() const
  {
    const auto truth = truth_.last();
    return truth ? truth->pose.pose.position.x + 0.8 : 0.0;  // the map begins at the IMU
  }
  bool sees(const std::string& label) const
  {
    const auto obstacles = obstacles_.last();
    return obstacles && std::any_of(obstacles->obstacles.begin(), obstacles->obstacles.end(),
                                    [&label](const pi_detect::Obstacle3D& one) { return one.label == label; });
  }

  ros::Publisher commands_;
  Collector<pi_vehicle::VehicleState> states_{"vehicle_state"};
  Collector<nav_msgs::Odometry> truth_{"ground_truth/odometry"};
  Collector<pi_detect::ObstacleArray> obstacles_{"ground_truth/obstacles"};
  Collector<sensor_msgs::Image> left_{"left/image_raw"};
  Collector<sensor_msgs::Image> right_{"right/image_raw"};
  Collector<sensor_msgs::CameraInfo> left_info_{"left/camera_info"};
  Collector<sensor_msgs::Imu> imu_{"imu/data"};
  Collector<std_msgs::String> scenario_{"scenario"};
  DiagnosticCollector diagnostics_;
};

TEST_F(Simulator, DrivesFiveMetresAndSeesEverything)
{
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return truth_.last() && scenario_.last(); }));
  EXPECT_NEAR(0.0, way(), 0.01);
  EXPECT_NE(std::string::npos, scenario_.last()->data.find("\"name\":\"test\""));
  ASSERT_TRUE(drivesUntil(1.5, [this] { return way() > 5.0; })) << way();
  EXPECT_NEAR(0.0, truth_.last()->pose.pose.position.y, 0.05);
  EXPECT_GT(truth_.last()->twist.twist.linear.x, 1.0);
  EXPECT_NEAR(states_.last()->odometer, way(), 0.5);

  // Pictures in pairs of the same stamps, with something in them.
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return left_.messages().size() > 10 && right_.messages().size() > 10; }));
  const auto pair = right_.messages()[5];
  ASSERT_TRUE(left_.waitForStamp(pair->header.stamp));
  ASSERT_TRUE(left_info_.waitForStamp(pair->header.stamp));
  EXPECT_EQ("right_optical", pair->header.frame_id);
  EXPECT_EQ("bgr8", pair->encoding);
  EXPECT_EQ(3u * 320u * 240u, pair->data.size());
  EXPECT_GT(*std::max_element(pair->data.begin(), pair->data.end()), 100);

  // The IMU knows gravity, every 5 ms.
  const auto samples = imu_.messages();
  ASSERT_GT(samples.size(), 100u);
  double sum = 0.0;
  for (const auto& sample : samples)
  {
    sum += sample->linear_acceleration.z;
  }
  EXPECT_NEAR(9.81, sum / static_cast<double>(samples.size()), 0.1);
  EXPECT_NEAR(0.005, (samples[50]->header.stamp - samples[49]->header.stamp).toSec(), 1e-6);
  EXPECT_TRUE(diagnostics_.waitForSummary("simulator: world", OK, "scenario test")) << diagnostics_.text();
}

TEST_F(Simulator, AnActorGoesWhenToldAndIsInTheTruth)
{
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return sees("person"); }));
  EXPECT_EQ("", command("actor child go"));
  ASSERT_TRUE(obstacles_.waitFor(
      [](const pi_detect::ObstacleArray& array)
      {
        return std::any_of(array.obstacles.begin(), array.obstacles.end(),
                           [](const pi_detect::Obstacle3D& one)
                           { return one.label == "person" && one.moving && one.velocity.y > 0.5; });
      }));
  EXPECT_NE(std::string::npos, command("actor nobody go").find("must be one of: child"));
  std::ifstream log(folder()->path() + "/log.jsonl");
  std::string text((std::istreambuf_iterator<char>(log)), std::istreambuf_iterator<char>());
  EXPECT_NE(std::string::npos, text.find("\"type\":\"trigger\",\"actor\":\"child\""));
  EXPECT_NE(std::string::npos, text.find("\"type\":\"state\",\"pose\":["));
}

TEST_F(Simulator, UnpluggedTheVehicleStopsAndPluggedInItGoesOn)
{
  const auto fast = [this] { return truth_.last()->twist.twist.linear.x > 1.0; };
  ASSERT_TRUE(drivesUntil(1.5, fast));
  EXPECT_EQ("", command("unplug"));
  ASSERT_TRUE(drivesUntil(1.5, [this] { return states_.last()->mode == pi_vehicle::VehicleState::DISCONNECTED; }));
  ASSERT_TRUE(drivesUntil(1.5, [this] { return std::abs(truth_.last()->twist.twist.linear.x) < 0.01; }));
  EXPECT_EQ("", command("plug"));
  ASSERT_TRUE(drivesUntil(1.5, fast));
}

TEST_F(Simulator, DarkCamerasSendBlackPicturesAndThoseThatAreOffNone)
{
  EXPECT_EQ("", command("camera left dark"));
  EXPECT_TRUE(left_.waitFor([](const sensor_msgs::Image& image)
                            { return *std::max_element(image.data.begin(), image.data.end()) == 0; }));
  EXPECT_EQ("", command("camera right off"));
  ASSERT_TRUE(until(TIMEOUT_S,
                    [this]  // what was being rendered has come
                    {
                      return left_.last() && right_.last() &&
                             left_.last()->header.stamp - right_.last()->header.stamp > ros::Duration(0.5);
                    }));
  EXPECT_EQ("", command("camera both on"));
  const ros::Time dark = right_.last()->header.stamp;
  EXPECT_TRUE(right_.waitFor([dark](const sensor_msgs::Image& image) { return image.header.stamp > dark; }));
}

TEST_F(Simulator, AnImuThatIsOffSendsNothingAndGoesOnInTime)
{
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return imu_.last() && truth_.last(); }));
  EXPECT_NE("", command("imu perhaps"));
  ASSERT_EQ("", command("imu off"));
  const ros::Duration pause(0.5);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return truth_.last()->header.stamp - imu_.last()->header.stamp > pause; }));
  const ros::Time reached = truth_.last()->header.stamp;
  ASSERT_EQ("", command("imu on"));
  ASSERT_TRUE(imu_.waitFor([reached](const sensor_msgs::Imu& sample) { return sample.header.stamp > reached; }));
  const auto samples = imu_.messages();
  const auto pauses =
      std::count_if(samples.begin() + 1, samples.end(),
                    [&](const auto& sample) { return sample->header.stamp - (&sample)[-1]->header.stamp > pause; });
  EXPECT_EQ(1, pauses);
}

}  // namespace
}  // namespace pi_simulation

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "vehicle_simulator_test");
}
