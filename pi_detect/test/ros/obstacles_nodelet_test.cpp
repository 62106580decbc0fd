// Judge of obstacles_nodelet.test.

#include "ros/street_on_graph.h"

#include <gtest/gtest.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_detect/Track2DArray.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/test_support/on_graph.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/MarkerArray.h>

#include <cmath>
#include <memory>
#include <string>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;
constexpr double BOX_X = 5.0;

class ObstaclesNodelet : public testing::Test
{
protected:
  void load(const std::string& source = "rectified")
  {
    ros::param::set("/obstacles/source", source);
    ros::param::set("/obstacles/diagnostic_period", 0.1);
    ros::param::set("/obstacles/input_timeout_s", 1.0);
    ros::param::set("/obstacles/warning_period_s", 0.5);
    ros::param::set("/obstacles/max_track_age_s", 0.05);
    ASSERT_TRUE(loadNodelet("/obstacles", "pi_detect/obstacles"));
    loaded_ = true;
  }
  void TearDown() override
  {
    if (loaded_)
    {
      EXPECT_TRUE(unloadNodelet("/obstacles"));
      ros::param::del("/obstacles");
    }
  }

  /// Shows the street again and again. @return the first array that fits.
  boost::shared_ptr<const ObstacleArray> showUntil(const std::function<ros::Time()>& show,
                                                   const std::function<bool(const ObstacleArray&)>& fits)
  {
    boost::shared_ptr<const ObstacleArray> found;
    const bool in_time = until(
        TIMEOUT_S,
        [&]
        {
          const ros::Time stamp = show();
          if (!obstacles_->waitFor([&stamp](const ObstacleArray& array) { return array.header.stamp == stamp; }, 2.0))
          {
            return false;
          }
          const auto last = obstacles_->last();
          found = fits(*last) ? last : nullptr;
          return found != nullptr;
        });
    EXPECT_TRUE(in_time) << text();
    return found;
  }

  /// The box, which stands on the ground in the middle.
  static const ObstacleArray::_obstacles_type::value_type* boxOf(const ObstacleArray& array)
  {
    for (const auto& obstacle : array.obstacles)
    {
      if (std::abs(obstacle.distance - BOX_X) < 0.05 * BOX_X && std::abs(obstacle.position.y) < 0.3)
      {
        return &obstacle;
      }
    }
    return nullptr;
  }
  static bool hasBox(const ObstacleArray& array) { return boxOf(array) != nullptr; }

  std::string text() const { return diagnostics_.text() + log_.text(); }

  const RenderedStreet street_ = RenderedStreet::make(BOX_X);
  StreetOnGraph graph_;
  DiagnosticCollector diagnostics_;
  LogCollector log_;
  bool loaded_ = false;
  std::unique_ptr<Collector<ObstacleArray>> obstacles_ = std::make_unique<Collector<ObstacleArray>>("obstacles");
};

TEST_F(ObstaclesNodelet, SaysWhereABoxIs)
{
  load();
  Collector<visualization_msgs::MarkerArray> markers("markers");
  Collector<sensor_msgs::PointCloud2> points("obstacle_points");
  Collector<stereo_msgs::DisparityImage> disparities("disparity_image");
  ASSERT_TRUE(graph_.waitForPairListeners());
  ASSERT_TRUE(markers.waitForPublisher() && points.waitForPublisher() && disparities.waitForPublisher());
  const auto array = showUntil([this] { return graph_.showPair(street_); }, hasBox);
  ASSERT_TRUE(array);
  EXPECT_EQ("base_link", array->header.frame_id);
  const auto& box = *boxOf(*array);
  EXPECT_NEAR(1.0, box.size.y, 0.25);
  EXPECT_NEAR(0.6, box.position.z, 0.2);
  EXPECT_EQ("", box.label);
  EXPECT_EQ(-1, box.class_id);

  ASSERT_TRUE(points.waitForStamp(array->header.stamp));
  EXPECT_EQ("base_link", points.last()->header.frame_id);
  EXPECT_GT(points.last()->width, 50u);
  ASSERT_TRUE(disparities.waitForStamp(array->header.stamp));
  const cv::Mat disparity = fromMsg(*disparities.last());
  // In the middle of the box.
  EXPECT_NEAR(street_.disparity.at<float>(210, 320), disparity.at<float>(210, 320), 0.5);
  EXPECT_TRUE(markers.waitFor([](const visualization_msgs::MarkerArray& all)
                              { return !all.markers.empty() && all.markers[0].header.frame_id == "base_link"; }));
}

TEST_F(ObstaclesNodelet, SaysTheSameFromADisparityImage)
{
  load("disparity");
  ASSERT_TRUE(graph_.waitForDisparityListeners());
  const auto array = showUntil([this] { return graph_.showDisparity(street_); }, hasBox);
  ASSERT_TRUE(array);
  EXPECT_NEAR(BOX_X, boxOf(*array)->distance, 0.02 * BOX_X);
  EXPECT_EQ(0u, graph_.listeners());
}

TEST_F(ObstaclesNodelet, WarnsIfNearThingsAreNotMeasured)
{
  load("disparity");
  ASSERT_TRUE(graph_.waitForDisparityListeners());
  ASSERT_TRUE(showUntil([this] { return graph_.showDisparity(street_, 3.5); }, hasBox));
  // The vehicle's front is 1 m before the camera.
  EXPECT_TRUE(diagnostics_.waitForSummary("obstacles: obstacles", WARN, "nearer than 2.5 m before the vehicle"))
      << text();
  EXPECT_TRUE(log_.waitForText("nearer than 2.5 m before the vehicle are not measured")) << text();
  ASSERT_TRUE(showUntil([this] { return graph_.showDisparity(street_); }, hasBox));
  EXPECT_TRUE(diagnostics_.waitForSummary("obstacles: obstacles", OK, "nearest 5.0 m")) << text();
}

TEST_F(ObstaclesNodelet, WorksWithoutOdometryAndSaysSo)
{
  load();
  ASSERT_TRUE(graph_.waitForPairListeners());
  ASSERT_TRUE(showUntil([this] { return graph_.showPair(street_); }, hasBox));
  EXPECT_TRUE(diagnostics_.waitForSummary("motion", WARN, "velocities are relative to the vehicle")) << text();
  EXPECT_TRUE(log_.waitForText("tf has no odom -> base_link")) << text();
}

TEST_F(ObstaclesNodelet, UsesOdometryWhereThereIsOne)
{
  load();
  ASSERT_TRUE(graph_.waitForPairListeners());
  // The vehicle drives at 1 m/s; what it sees all the same at 5 m goes before it.
  double x = 0.0;
  const auto show = [&]
  {
    const ros::Time stamp = graph_.showPair(street_);
    x += 0.1;
    broadcastOdom(stamp, x);
    return stamp;
  };
  const auto array = showUntil(
      show, [](const ObstacleArray& all) { return hasBox(all) && std::abs(boxOf(all)->velocity.x - 1.0) < 0.2; });
  ASSERT_TRUE(array);
  EXPECT_TRUE(diagnostics_.waitForSummary("motion", OK, "over the ground")) << text();
}

TEST_F(ObstaclesNodelet, TakesLabelsFromTracks)
{
  load();
  ros::Publisher tracks = ros::NodeHandle().advertise<Track2DArray>("tracks", 10);
  ASSERT_TRUE(graph_.waitForPairListeners());
  ASSERT_TRUE(until(TIMEOUT_S, [&tracks] { return tracks.getNumSubscribers() > 0; }));
  ros::Time last;
  const auto show = [&]
  {
    // A track of the last pair: the one of this pair may come when it is worked on already.
    if (!last.isZero())
    {
      ObjectTrack track;
      track.id = 9;
      track.class_id = 4;
      track.score = 0.9F;
      track.box = {270.0F, 170.0F, 370.0F, 290.0F};
      std_msgs::Header header;
      header.stamp = last + ros::Duration(0.1);
      tracks.publish(toMsg({track}, Labels{{4, "crate"}}, header));
    }
    last = graph_.showPair(street_);
    return last;
  };
  const auto array =
      showUntil(show, [](const ObstacleArray& all) { return hasBox(all) && boxOf(all)->label == "crate"; });
  ASSERT_TRUE(array);
  EXPECT_EQ(4, boxOf(*array)->class_id);
  EXPECT_EQ(9, boxOf(*array)->track_id);
}

TEST_F(ObstaclesNodelet, NamesMissingInputsAndSwappedCameras)
{
  load();
  ASSERT_TRUE(graph_.waitForPairListeners());
  EXPECT_TRUE(diagnostics_.waitForSummary("input", WARN, "nothing on /left/image_rect")) << text();
  EXPECT_TRUE(log_.waitForText("/right/camera_info: nothing for")) << text();
  graph_.showSwapped(street_);
  EXPECT_TRUE(until(TIMEOUT_S,
                    [this]
                    {
                      graph_.showSwapped(street_);
                      return diagnostics_.waitFor(
                          [](const diagnostic_msgs::DiagnosticArray& array)
                          {
                            for (const auto& status : array.status)
                            {
                              if (status.level == ERROR &&
                                  status.message.find("the cameras are swapped") != std::string::npos)
                              {
                                return true;
                              }
                            }
                            return false;
                          },
                          0.5);
                    }))
      << text();
  ASSERT_TRUE(showUntil([this] { return graph_.showPair(street_); }, hasBox));
}

TEST_F(ObstaclesNodelet, PublishesNothingWhileTheCamerasSeeNothing)
{
  load();
  ASSERT_TRUE(graph_.waitForPairListeners());
  ASSERT_TRUE(showUntil([this] { return graph_.showPair(street_); }, hasBox));
  RenderedStreet dark = street_;
  dark.left = cv::Mat(street_.left.size(), CV_8UC1, cv::Scalar(0));  // not zeros(): that would fill the street's
  dark.right = dark.left.clone();
  const ros::Time first_dark = graph_.showPair(dark);
  ASSERT_TRUE(diagnostics_.waitForSummary("obstacles: obstacles", WARN, "dark, covered or dirty lenses")) << text();
  EXPECT_LT(obstacles_->last()->header.stamp, first_dark);
  ASSERT_TRUE(showUntil([this] { return graph_.showPair(street_); }, hasBox));
}

TEST_F(ObstaclesNodelet, SubscribesOnlyWhileSomebodyListens)
{
  obstacles_.reset();
  load();
  ASSERT_TRUE(diagnostics_.waitForSummary("input", OK, "nobody listens")) << text();
  EXPECT_EQ(0u, graph_.listeners());
  {
    const Collector<sensor_msgs::PointCloud2> points("obstacle_points");
    EXPECT_TRUE(graph_.waitForPairListeners());
  }
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return graph_.listeners() == 0; }));
}

TEST_F(ObstaclesNodelet, RefusesAWrongParameterByName)
{
  ASSERT_TRUE(log_.waitForNode());
  ros::param::set("/wrong/source", "mono");
  EXPECT_FALSE(loadNodelet("/wrong", "pi_detect/obstacles"));
  EXPECT_TRUE(log_.waitForText("parameter /wrong/source = \"mono\", must be rectified, raw or disparity")) << text();
}

}  // namespace
}  // namespace pi_detect

int main(int argc, char** argv)
{
  return pi_detect::runOnGraph(argc, argv, "obstacles_nodelet_test");
}
