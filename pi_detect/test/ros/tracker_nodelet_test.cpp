// Judge of tracker_nodelet.test.

#include <gtest/gtest.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/Track2DArray.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/test_support/on_graph.h>

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
  void publish(double time_s)
  {
    Detection person;
    person.class_id = PERSON;
    person.score = 0.9F;
    const auto left = static_cast<float>(100.0 + 50.0 * time_s);
    person.box = Box{left, 50.0F, left + 40.0F, 150.0F};
    std_msgs::Header header;
    header.stamp = ros::Time(1000.0 + time_s);
    header.frame_id = "left_optical";
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
