// Judge of tracker_nodelet.test.

#include <gtest/gtest.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/Track2DArray.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/test_support/on_graph.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <memory>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

constexpr int PERSON = 7;

class TrackerNodelet : public testing::Test
{
protected:
  TrackerNodelet()
    : detections_(node_.advertise<Detection2DArray>("detections", 10))
    , labels_(node_.advertise<LabelArray>("labels", 1, true))
  {
  }

  bool listens(uint32_t number)
  {
    return until(TIMEOUT_S, [this, number] { return detections_.getNumSubscribers() == number; });
  }

  /// A person who walks to the right.
  void publish(double time_s) { publishPerson(1000.0 + time_s, 120.0 + 50.0 * time_s, "left_optical"); }

  void publishPerson(double stamp_s, double x, const char* frame)
  {
    Detection person;
    person.class_id = PERSON;
    person.score = 0.9F;
    const auto left = static_cast<float>(x - 20.0);
    person.box = Box{left, 50.0F, left + 40.0F, 150.0F};
    std_msgs::Header header;
    header.stamp = ros::Time(stamp_s);
    header.frame_id = frame;
    detections_.publish(toMsg(Detections{person}, header));
  }

  ros::NodeHandle node_;
  ros::Publisher detections_;
  ros::Publisher labels_;
};

TEST_F(TrackerNodelet, FollowsWhatComesFromElsewhere)
{
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return labels_.getNumSubscribers() == 1; }));
  EXPECT_EQ(0u, detections_.getNumSubscribers());
  {
    const Collector<Track2DArray> tracks("tracks");
    ASSERT_TRUE(listens(1));
    LabelArray labels;
    labels.ids = {PERSON};
    labels.names = {"person"};
    labels_.publish(labels);
    // Labels and detections come over links of their own: until the name is known, pictures go on.
    double time_s = 0.0;
    ASSERT_TRUE(until(TIMEOUT_S,
                      [&]
                      {
                        publish(time_s += 0.1);
                        const auto last = tracks.last();
                        return last && last->tracks.size() == 1 && last->tracks[0].label == "person";
                      }));
    const Track2DArrayConstPtr last = tracks.last();
    EXPECT_EQ("left_optical", last->header.frame_id);
    EXPECT_EQ(PERSON, last->tracks[0].class_id);
    EXPECT_GT(last->tracks[0].velocity_x, 0.0);
  }
  EXPECT_TRUE(listens(0));
}

TEST_F(TrackerNodelet, KnowsHowTheCameraTurned)
{
  // From picture to picture the camera turns 5 degrees to the left, so who stands still moves 52 px to the right.
  constexpr double TURN = 0.0873;
  constexpr double FOCAL_PX = 600.0;
  constexpr int STANDING = 20;  // pictures
  constexpr int TURNING = 10;
  constexpr double PERIOD_S = 0.1;
  ros::Publisher tf = node_.advertise<tf2_msgs::TFMessage>("/tf", 1);
  ros::Publisher infos = node_.advertise<sensor_msgs::CameraInfo>("camera_info", 1, true);
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.K = {FOCAL_PX, 0.0, 320.0, 0.0, FOCAL_PX, 240.0, 0.0, 0.0, 1.0};
  infos.publish(info);
  const Collector<Track2DArray> tracks("tracks");
  ASSERT_TRUE(listens(1));
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return infos.getNumSubscribers() == 1 && tf.getNumSubscribers() == 1; }));
  // tf comes over a link of its own: all of it goes before the pictures, and in the first ones the camera stands.
  const auto yawAt = [](int picture) { return TURN * std::max(0, picture - STANDING); };
  tf2_msgs::TFMessage way;
  for (int picture = 0; picture <= STANDING + TURNING; ++picture)
  {
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = ros::Time(2000.0 + PERIOD_S * picture);
    transform.header.frame_id = "odom";
    transform.child_frame_id = "turning_optical";
    // z forward, x right, y down: to the left is about -y.
    transform.transform.rotation.y = -std::sin(0.5 * yawAt(picture));
    transform.transform.rotation.w = std::cos(0.5 * yawAt(picture));
    way.transforms.push_back(transform);
  }
  tf.publish(way);
  for (int picture = 0; picture <= STANDING + TURNING; ++picture)
  {
    const double stamp_s = 2000.0 + PERIOD_S * picture;
    publishPerson(stamp_s, 320.0 + FOCAL_PX * std::tan(yawAt(picture) - 0.4), "turning_optical");
    ASSERT_TRUE(tracks.waitForStamp(ros::Time(stamp_s)));
  }
  ASSERT_EQ(1u, tracks.last()->tracks.size());
  const Track2D last = tracks.last()->tracks.front();
  EXPECT_GT(last.age.toSec(), 2.5) << "one track from the start";
  EXPECT_GT(last.velocity_x, 200.0) << "in the picture";
}

TEST_F(TrackerNodelet, SaysWhatIsWrongWithMessages)
{
  const LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  const Collector<Track2DArray> tracks("tracks");
  ASSERT_TRUE(listens(1));
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return labels_.getNumSubscribers() == 1; }));
  LabelArray labels;
  labels.ids = {1, 2};
  labels.names = {"one"};
  labels_.publish(labels);
  EXPECT_TRUE(log.waitFor([](const rosgraph_msgs::Log& line)
                          { return line.msg.find("/labels: ids has 2 entries, names 1") == 0; }));
  detections_.publish(Detection2DArray());
  EXPECT_TRUE(
      log.waitFor([](const rosgraph_msgs::Log& line) { return line.msg.find("/detections: stamp is 0") == 0; }));
}

}  // namespace
}  // namespace pi_detect

int main(int argc, char** argv)
{
  return pi_detect::runOnGraph(argc, argv, "tracker_nodelet_test");
}
