// Judge of vio_outputs.test.

#include "drive_on_graph.h"

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_slam/LoadMap.h>
#include <pi_slam/SaveMap.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_srvs/Trigger.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>
#include <unistd.h>
#include "ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <vector>

namespace pi_slam
{
namespace
{

constexpr double DRIVE_S = 5.0;
constexpr double TIMEOUT_S = 10.0;

/// The drive is played once; the tests look at what came out of it.
class VioOutputs : public testing::Test
{
protected:
  struct Recording
  {
    Recording() : drive(SyntheticDrive::make(DRIVE_S)) {}

    DriveOnGraph drive;
    Collector<nav_msgs::Odometry> odometry{"odometry", 5000};
    Collector<tf2_msgs::TFMessage> tf{"/tf", 5000};
    Collector<nav_msgs::Path> path{"path", 10};
    Collector<sensor_msgs::PointCloud2> points{"points", 10};
    Collector<sensor_msgs::Image> tracks{"/vio/debug/tracks", 100};
    Collector<diagnostic_msgs::DiagnosticArray> diagnostics{"/diagnostics", 100};
    LogCollector log;
  };

  static void SetUpTestSuite()
  {
    recording_ = std::make_unique<Recording>();
    ASSERT_TRUE(recording_->drive.waitForListeners(TIMEOUT_S));
    ASSERT_TRUE(until(TIMEOUT_S, [] { return recording_->odometry.publishers() > 0; }));
    recording_->drive.play(0.0, DRIVE_S, 1.0);
    const int64_t last_ns = recording_->drive.drive().imu.back().stamp_ns - 100000000;
    recording_->odometry.waitFor(
        [last_ns](const nav_msgs::Odometry& odometry) { return fromMsg(odometry.header.stamp) >= last_ns; }, TIMEOUT_S);
  }
  static void TearDownTestSuite() { recording_.reset(); }

  using Values = std::map<std::string, std::string>;

  /// Keys and values of the status whose name ends so.
  static Values valuesOf(const diagnostic_msgs::DiagnosticArray& array, const std::string& name)
  {
    Values values;
    for (const diagnostic_msgs::DiagnosticStatus& status : array.status)
    {
      if (status.name.size() >= name.size() &&
          status.name.compare(status.name.size() - name.size(), name.size(), name) == 0)
      {
        for (const diagnostic_msgs::KeyValue& value : status.values)
        {
          values[value.key] = value.value;
        }
      }
    }
    return values;
  }

  /// The newest.
  static Values status(const std::string& name)
  {
    Values values;
    for (const auto& array : recording_->diagnostics.messages())
    {
      const Values newer = valuesOf(*array, name);
      values = newer.empty() ? values : newer;
    }
    return values;
  }

  static std::unique_ptr<Recording> recording_;
};
std::unique_ptr<VioOutputs::Recording> VioOutputs::recording_;

TEST_F(VioOutputs, GivesOdometryForEveryImuSample)
{
  const auto odometries = recording_->odometry.messages();
  // A start from rest takes about half a second of pictures; the rest of the drive has a pose for every sample.
  ASSERT_GT(odometries.size(), 500u) << recording_->log.text();
  for (size_t i = 1; i < odometries.size(); ++i)
  {
    EXPECT_NEAR((odometries[i]->header.stamp - odometries[i - 1]->header.stamp).toSec(), 0.005, 1e-6);
  }
}

TEST_F(VioOutputs, OdometryHasFramesAndFiniteCovariances)
{
  const auto odometries = recording_->odometry.messages();
  ASSERT_FALSE(odometries.empty());
  for (const auto& odometry : odometries)
  {
    ASSERT_EQ("odom", odometry->header.frame_id);
    ASSERT_EQ("base_link", odometry->child_frame_id);
    for (const auto* covariance : {&odometry->pose.covariance, &odometry->twist.covariance})
    {
      for (int row = 0; row < 6; ++row)
      {
        ASSERT_GT((*covariance)[7 * row], 0.0);
        for (int column = 0; column < 6; ++column)
        {
          ASSERT_TRUE(std::isfinite((*covariance)[6 * row + column]));
          ASSERT_DOUBLE_EQ((*covariance)[6 * row + column], (*covariance)[6 * column + row]);
        }
      }
    }
  }
}

TEST_F(VioOutputs, OdometryOfTheBaseFollowsTheTruth)
{
  const auto odometries = recording_->odometry.messages();
  ASSERT_GT(odometries.size(), 500u);
  const SyntheticDrive& drive = recording_->drive.drive();
  const auto truth = [&drive](int64_t stamp_ns)
  {
    const auto index = static_cast<size_t>(std::llround((stamp_ns - drive.imu.front().stamp_ns) / 5e6));
    return drive.T_world_body.at(index) * DriveOnGraph::T_base_body().inverse();
  };
  const Eigen::Isometry3d T_world_odom =
      truth(fromMsg(odometries.front()->header.stamp)) * fromMsg(odometries.front()->pose.pose).inverse();
  const Eigen::Isometry3d T_world_base = truth(fromMsg(odometries.back()->header.stamp));
  const Eigen::Isometry3d error = T_world_base.inverse() * T_world_odom * fromMsg(odometries.back()->pose.pose);
  // About 5 m with small pictures of a wide lens: 2 % is far more than odometry needs, and far less than a wrong lever
  // arm, frame or scale would give.
  EXPECT_GT((T_world_base.translation() - truth(drive.imu.front().stamp_ns).translation()).norm(), 4.0);
  EXPECT_LT(error.translation().norm(), 0.1);
  EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.03);
  const geometry_msgs::Vector3& v_base = odometries.back()->twist.twist.linear;
  EXPECT_NEAR(v_base.x, 1.5, 0.1);
  EXPECT_NEAR(v_base.y, 0.0, 0.1);
  EXPECT_NEAR(v_base.z, 0.0, 0.1);
}

TEST_F(VioOutputs, TfLeadsFromMapToBaseLink)
{
  tf2_ros::Buffer buffer;
  std::set<ros::Time> stamps;
  for (const auto& message : recording_->tf.messages())
  {
    for (const geometry_msgs::TransformStamped& transform : message->transforms)
    {
      buffer.setTransform(transform, "test");
      stamps.insert(transform.header.stamp);
    }
  }
  const auto odometries = recording_->odometry.messages();
  ASSERT_GT(odometries.size(), 500u);
  const double span_s = (odometries.back()->header.stamp - odometries.front()->header.stamp).toSec();
  EXPECT_NEAR(static_cast<double>(stamps.size()), 50.0 * span_s, 0.1 * 50.0 * span_s);  // tf_rate_hz
  const auto offBy = [&buffer](const nav_msgs::Odometry& odometry)
  {
    const auto T_odom_base = fromMsg(buffer.lookupTransform("odom", "base_link", odometry.header.stamp).transform);
    return (T_odom_base.translation() - fromMsg(odometry.pose.pose).translation()).norm();
  };
  std::vector<double> between;
  for (size_t i = odometries.size() / 4; i < 3 * odometries.size() / 4; ++i)
  {
    const double off_m = offBy(*odometries[i]);
    if (stamps.count(odometries[i]->header.stamp) > 0)
    {
      EXPECT_LT(off_m, 1e-6) << odometries[i]->header.stamp;
    }
    else
    {
      between.push_back(off_m);
    }
  }
  // Between two transforms 20 ms apart, interpolated; where pictures correct the pose meanwhile it is off by more.
  ASSERT_GT(between.size(), 200u);
  std::nth_element(between.begin(), between.begin() + between.size() / 2, between.end());
  EXPECT_LT(between[between.size() / 2], 0.005);
  const auto& odometry = *odometries[odometries.size() / 2];
  EXPECT_NO_THROW(buffer.lookupTransform("map", "base_link", odometry.header.stamp));
}

TEST_F(VioOutputs, PathEndsWhereTheVehicleIs)
{
  const auto paths = recording_->path.messages();
  ASSERT_FALSE(paths.empty());
  const nav_msgs::Path& path = *paths.back();
  EXPECT_EQ("map", path.header.frame_id);
  ASSERT_GT(path.poses.size(), 5u);
  for (size_t i = 1; i < path.poses.size(); ++i)
  {
    EXPECT_LT(path.poses[i - 1].header.stamp, path.poses[i].header.stamp);
  }
  for (const auto& odometry : recording_->odometry.messages())
  {
    if (odometry->header.stamp == path.poses.back().header.stamp)
    {
      // Corrected once the pair was worked on; path_spacing_m and the correction are some centimetres.
      EXPECT_LT((fromMsg(odometry->pose.pose).translation() - fromMsg(path.poses.back().pose).translation()).norm(),
                0.1);
    }
  }
}

TEST_F(VioOutputs, PointsHaveIntensity)
{
  const auto clouds = recording_->points.messages();
  ASSERT_FALSE(clouds.empty());
  const sensor_msgs::PointCloud2& cloud = *clouds.back();
  EXPECT_EQ("map", cloud.header.frame_id);
  ASSERT_GT(cloud.width, 20u);
  ASSERT_EQ(cloud.data.size(), static_cast<size_t>(cloud.width) * cloud.point_step);
  sensor_msgs::PointCloud2ConstIterator<float> intensity(cloud, "intensity");
  float brightest = 0.0F;
  for (; intensity != intensity.end(); ++intensity)
  {
    brightest = std::max(brightest, *intensity);
  }
  EXPECT_GT(brightest, 10.0F);
  EXPECT_LE(brightest, 255.0F);
}

TEST_F(VioOutputs, TracksShowBothPictures)
{
  const auto pictures = recording_->tracks.messages();
  ASSERT_GT(pictures.size(), 10u);
  EXPECT_EQ("bgr8", pictures.back()->encoding);
  EXPECT_EQ(640u, pictures.back()->width);
  EXPECT_EQ(240u, pictures.back()->height);
}

TEST_F(VioOutputs, DiagnosticsTellStateFrameTimeAndInputs)
{
  const auto odometry = status("odometry");
  ASSERT_FALSE(odometry.empty());
  EXPECT_EQ("tracking", odometry.at("state"));
  EXPECT_GT(std::stod(odometry.at("frame time, mean [ms]")), 0.0);
  EXPECT_GE(std::stod(odometry.at("frame time, p99 [ms]")), std::stod(odometry.at("frame time, mean [ms]")));
  EXPECT_LT(std::stoi(odometry.at("pairs that took longer than a frame")), std::stoi(odometry.at("pairs used")));
  EXPECT_GT(std::stod(odometry.at("longest time between two odometries [ms]")), 0.0);
  EXPECT_GE(std::stoi(odometry.at("times over 20 ms between two odometries")), 0);
  EXPECT_GT(std::stoi(odometry.at("features")), 20);
  EXPECT_GT(std::stoi(odometry.at("inliers")), 20);
  const auto inputs = status("inputs");
  EXPECT_EQ(1u, inputs.count("pairs dropped to keep up"));
  EXPECT_EQ(1u, inputs.count("pictures without partner"));
  // While the drive went on; it has ended by now.
  EXPECT_TRUE(recording_->diagnostics.waitFor(
      [](const diagnostic_msgs::DiagnosticArray& array)
      {
        const auto values = valuesOf(array, "inputs");
        const auto rate = values.find("/imu/data [Hz]");
        return rate != values.end() && std::stod(rate->second) > 100.0;
      },
      0.0));
  EXPECT_GT(std::stoi(status("map").at("keyframes")), 1);
}

// The following change the node, in this order.

TEST_F(VioOutputs, MapIsSavedAndLoaded)
{
  const std::string file =
      (std::filesystem::temp_directory_path() / ("pi_slam_vio_outputs_" + std::to_string(getpid()) + ".map")).string();
  SaveMap save;
  save.request.file = "map.bin";
  ASSERT_TRUE(ros::service::call("/vio/save_map", save));
  EXPECT_FALSE(save.response.success);
  EXPECT_NE(std::string::npos, save.response.message.find("absolute path")) << save.response.message;

  save.request.file = file;
  ASSERT_TRUE(ros::service::call("/vio/save_map", save));
  EXPECT_TRUE(save.response.success) << save.response.message;
  EXPECT_TRUE(std::filesystem::exists(file));

  LoadMap load;
  load.request.file = file + ".missing";
  ASSERT_TRUE(ros::service::call("/vio/load_map", load));
  EXPECT_FALSE(load.response.success);
  EXPECT_NE(std::string::npos, load.response.message.find(load.request.file)) << load.response.message;

  load.request.file = file;
  ASSERT_TRUE(ros::service::call("/vio/load_map", load));
  EXPECT_TRUE(load.response.success) << load.response.message;
  EXPECT_TRUE(until(TIMEOUT_S, [] { return status("map").at("loaded from a file") == "yes"; }));
  std::filesystem::remove(file);
}

TEST_F(VioOutputs, ResetBeginsAnewAtTheOrigin)
{
  std_srvs::Trigger reset;
  ASSERT_TRUE(ros::service::call("/vio/reset", reset));
  EXPECT_TRUE(reset.response.success);
  recording_->odometry.clear();
  recording_->drive.play(0.0, 2.0, 2.0, 100.0);
  EXPECT_TRUE(until(TIMEOUT_S, [] { return recording_->odometry.count() > 0; })) << recording_->log.text();
  const auto odometries = recording_->odometry.messages();
  ASSERT_FALSE(odometries.empty());
  // The drive begins at rest, so odometry begins at the IMU's place; the base is a lever arm away.
  EXPECT_LT((fromMsg(odometries.front()->pose.pose) * DriveOnGraph::T_base_body()).translation().norm(), 0.1);
}

}  // namespace
}  // namespace pi_slam

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "vio_outputs_test");
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
