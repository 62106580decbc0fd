// Judge of vio_faults.test.

#include "drive_on_graph.h"

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <std_srvs/Trigger.h>
#include "front_end/frame_features.h"
#include "ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

namespace pi_slam
{
namespace
{

constexpr double DRIVE_S = 5.0;
constexpr double TIMEOUT_S = 10.0;
constexpr double SPEED = 2.0;

/// One node for all tests. Each test plays the drive at stamps of its own, later than those before.
class VioFaults : public testing::Test
{
protected:
  using Faults = DriveOnGraph::Faults;

  struct Graph
  {
    Graph() : drive(SyntheticDrive::make(DRIVE_S)) {}

    DriveOnGraph drive;
    Collector<nav_msgs::Odometry> odometry{"odometry", 5000};
    Collector<diagnostic_msgs::DiagnosticArray> diagnostics{"/diagnostics", 100};
    LogCollector log;
  };

  static void SetUpTestSuite()
  {
    graph_ = std::make_unique<Graph>();
    ASSERT_TRUE(graph_->log.waitForNode(TIMEOUT_S));
    ASSERT_TRUE(until(TIMEOUT_S, [] { return graph_->odometry.publishers() > 0; }));
  }
  static void TearDownTestSuite() { graph_.reset(); }

  void SetUp() override
  {
    later_s_ += 100.0;
    graph_->log.clear();
    graph_->odometry.clear();
    graph_->diagnostics.clear();
  }

  /// Odometry from a fresh start, so that the next part of the drive meets a node that tracks.
  static void start()
  {
    std_srvs::Trigger reset;
    ASSERT_TRUE(ros::service::call("/vio/reset", reset));
    ASSERT_TRUE(reset.response.success) << reset.response.message;
    graph_->odometry.clear();
    graph_->drive.play(0.0, 2.0, SPEED, later_s_);
    ASSERT_TRUE(until(TIMEOUT_S, [] { return graph_->odometry.count() > 0; })) << graph_->log.text();
    graph_->odometry.clear();
  }

  static bool isLogged(const std::string& part) { return graph_->log.waitForText(part, TIMEOUT_S); }

  /// The diagnostics of a kind once they say so. @param part  of the summary or a value.
  static bool isDiagnosed(const std::string& part)
  {
    return graph_->diagnostics.waitFor(
        [&part](const diagnostic_msgs::DiagnosticArray& array)
        {
          for (const diagnostic_msgs::DiagnosticStatus& status : array.status)
          {
            const bool in_values = std::any_of(status.values.begin(), status.values.end(),
                                               [&part](const diagnostic_msgs::KeyValue& value)
                                               { return value.value.find(part) != std::string::npos; });
            if (in_values || status.message.find(part) != std::string::npos)
            {
              return true;
            }
          }
          return false;
        },
        TIMEOUT_S);
  }

  static bool odometryReaches(double drive_s)
  {
    const int64_t stamp_ns = graph_->drive.drive().imu.front().stamp_ns + std::llround(1e9 * (drive_s + later_s_));
    return graph_->odometry.waitFor([stamp_ns](const nav_msgs::Odometry& odometry)
                                    { return fromMsg(odometry.header.stamp) >= stamp_ns; },
                                    TIMEOUT_S);
  }

  static std::unique_ptr<Graph> graph_;
  static double later_s_;
};
std::unique_ptr<VioFaults::Graph> VioFaults::graph_;
double VioFaults::later_s_ = 0.0;

TEST_F(VioFaults, MissingCalibrationIsNamed)
{
  EXPECT_TRUE(isLogged("nothing on /left/camera_info; start the driver with a calibration, or set calibration/source"))
      << graph_->log.text();
  EXPECT_TRUE(isDiagnosed("no calibration"));
}

TEST_F(VioFaults, SilentInputsAreNamed)
{
  EXPECT_TRUE(isLogged("/imu/data: nothing for")) << graph_->log.text();
  EXPECT_TRUE(isLogged("/left/image_raw: nothing for")) << graph_->log.text();
}

TEST_F(VioFaults, SwappedCamerasAreRefusedUntilTheyAreRight)
{
  ASSERT_TRUE(graph_->drive.waitForListeners(TIMEOUT_S));
  Faults swapped;
  swapped.info = [](int camera, sensor_msgs::CameraInfo* info)
  { *info = graph_->drive.info(camera == LEFT ? RIGHT : LEFT); };
  const auto is_told = []
  { return graph_->log.waitForText("the cameras are swapped; swap the topics of left and right", 0.0); };
  EXPECT_TRUE(graph_->drive.playUntil(0.0, SPEED, later_s_, is_told, swapped)) << graph_->log.text();
  EXPECT_TRUE(isDiagnosed("the cameras are swapped"));
  EXPECT_EQ(0u, graph_->odometry.count());

  later_s_ += 10.0;
  EXPECT_TRUE(graph_->drive.playUntil(0.0, SPEED, later_s_, [] { return graph_->odometry.count() > 0; }, {}))
      << graph_->log.text();
}

TEST_F(VioFaults, WheelsOfAnotherFrameAreNamed)
{
  ros::NodeHandle node;
  ros::Publisher wheels = node.advertise<nav_msgs::Odometry>("wheel_odometry", 10);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return wheels.getNumSubscribers() > 0; }));
  nav_msgs::Odometry odometry;
  odometry.header.stamp = ros::Time(1.0);
  odometry.child_frame_id = "wheels";
  wheels.publish(odometry);
  EXPECT_TRUE(isLogged("/wheel_odometry: its twist is of the frame wheels, must be of base_link_frame = base_link"))
      << graph_->log.text();
  odometry.child_frame_id = "base_link";
  odometry.twist.twist.linear.x = std::nan("");
  wheels.publish(odometry);
  EXPECT_TRUE(isLogged("/wheel_odometry: a number is not finite")) << graph_->log.text();
}

TEST_F(VioFaults, PicturesOfAnotherSizeAreIgnoredUntilTheyFit)
{
  start();
  Faults small;
  small.image = [](int, sensor_msgs::Image* image)
  {
    image->width = 160;
    image->step = 160;
    return true;
  };
  graph_->drive.play(2.0, 2.4, SPEED, later_s_, small);
  EXPECT_TRUE(isLogged("/left/image_raw: picture is 160x240, but /left/camera_info is for 320x240"))
      << graph_->log.text();
  graph_->drive.play(2.4, 3.4, SPEED, later_s_);
  EXPECT_TRUE(odometryReaches(3.3));
  EXPECT_TRUE(isDiagnosed("tracking,"));
}

TEST_F(VioFaults, BlackPicturesLeaveTheImuAndPassOver)
{
  start();
  Faults black;
  black.image = [](int, sensor_msgs::Image* image)
  {
    std::fill(image->data.begin(), image->data.end(), 0);
    return true;
  };
  graph_->drive.play(2.0, 3.0, SPEED, later_s_, black);
  EXPECT_TRUE(isLogged("without content")) << graph_->log.text();
  EXPECT_TRUE(isDiagnosed("blind,"));
  graph_->diagnostics.clear();
  graph_->drive.play(3.0, 4.5, SPEED, later_s_);
  EXPECT_TRUE(isDiagnosed("tracking,")) << graph_->log.text();
  EXPECT_TRUE(odometryReaches(4.4));
  // From the samples of the IMU that came, not one was left out.
  EXPECT_GT(graph_->odometry.count(), 480u);
}

TEST_F(VioFaults, OneCameraAloneIsNamedAndOdometryGoesOn)
{
  start();
  Faults left_alone;
  left_alone.image = [](int camera, sensor_msgs::Image*) { return camera == LEFT; };
  graph_->drive.play(2.0, 3.5, SPEED, later_s_, left_alone);
  EXPECT_TRUE(isLogged("/right/image_raw: no picture beside that of the other camera")) << graph_->log.text();
  EXPECT_TRUE(odometryReaches(3.4));
}

TEST_F(VioFaults, GapOfTheImuIsNamedAndOdometryGoesOn)
{
  start();
  int64_t gap_ns = 0;
  Faults gap;
  gap.imu = [&gap_ns](sensor_msgs::Imu* imu)
  {
    gap_ns = gap_ns == 0 ? fromMsg(imu->header.stamp) : gap_ns;
    const int64_t since_ns = fromMsg(imu->header.stamp) - gap_ns;
    return since_ns < 100000000 || since_ns > 400000000;
  };
  graph_->drive.play(2.0, 3.5, SPEED, later_s_, gap);
  EXPECT_TRUE(isLogged("/data: gap of 0.3")) << graph_->log.text();
  EXPECT_TRUE(odometryReaches(3.4));
}

TEST_F(VioFaults, TimeThatGoesBackBeginsAnew)
{
  start();
  later_s_ -= 50.0;
  EXPECT_TRUE(graph_->drive.playUntil(0.0, SPEED, later_s_,
                                      []
                                      {
                                        return graph_->odometry.waitFor(
                                            [](const nav_msgs::Odometry& odometry) {
                                              return fromMsg(odometry.header.stamp) <
                                                     graph_->drive.drive().imu.back().stamp_ns +
                                                         std::llround(1e9 * later_s_);
                                            },
                                            0.0);
                                      },
                                      {}))
      << graph_->log.text();
  EXPECT_TRUE(isLogged("time went back by")) << graph_->log.text();
  later_s_ += 50.0;
}

TEST_F(VioFaults, ACameraThatIsLateIsNoTimeThatGoesBack)
{
  start();
  Faults late;
  int64_t begin_ns = 0;
  late.image = [&begin_ns](int camera, sensor_msgs::Image* image)
  {
    const int64_t stamp_ns = fromMsg(image->header.stamp);
    begin_ns = begin_ns == 0 ? stamp_ns : begin_ns;
    if (camera == LEFT)
    {
      return true;
    }
    image->header.stamp -= ros::Duration(0.7);
    return stamp_ns - begin_ns > 800000000;  // its own stamps go on
  };
  graph_->drive.play(2.0, 4.0, SPEED, later_s_, late);
  EXPECT_TRUE(odometryReaches(3.9));
  EXPECT_TRUE(isLogged("/right/image_raw: no picture beside that of the other camera")) << graph_->log.text();
  EXPECT_EQ(graph_->log.text().find("went back"), std::string::npos) << graph_->log.text();
}

TEST_F(VioFaults, MessagesThatCannotBeUsedAreNamed)
{
  start();
  Faults wrong;
  wrong.image = [](int camera, sensor_msgs::Image* image)
  {
    if (camera == LEFT)
    {
      image->encoding = "jpeg";
    }
    else
    {
      image->header.stamp = ros::Time();
    }
    return true;
  };
  wrong.imu = [](sensor_msgs::Imu* imu)
  {
    imu->linear_acceleration_covariance[0] = -1.0;
    return true;
  };
  graph_->drive.play(2.0, 2.4, SPEED, later_s_, wrong);
  EXPECT_TRUE(isLogged("/left/image_raw: encoding \"jpeg\" cannot be turned into grey levels")) << graph_->log.text();
  EXPECT_TRUE(isLogged("/right/image_raw: stamp is 0")) << graph_->log.text();
  EXPECT_TRUE(isLogged("/imu/data: linear_acceleration_covariance[0] = -1")) << graph_->log.text();
}

}  // namespace
}  // namespace pi_slam

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "vio_faults_test");
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
