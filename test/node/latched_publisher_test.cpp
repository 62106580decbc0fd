#include <gtest/gtest.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_msgs/String.h>

#include <set>
#include <string>
#include <vector>

namespace
{

constexpr int RACES = 60;  // each takes a tenth of a second, which roscpp needs to connect
constexpr double PATIENCE_S = 30.0;

/// Subscribes topics that the racer advertises at the same time. @return how many messages never came
size_t losses(const std::string& prefix, int count, double patience_s)
{
  ros::NodeHandle node;
  ros::Publisher races = node.advertise<std_msgs::String>("/race", static_cast<uint32_t>(count));
  const auto serve = [] { ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01)); };
  const ros::WallTime begin = ros::WallTime::now();
  while (races.getNumSubscribers() == 0 && (ros::WallTime::now() - begin).toSec() < PATIENCE_S)
  {
    serve();
  }
  EXPECT_EQ(1u, races.getNumSubscribers());
  std::set<std::string> missing;
  std::vector<ros::Subscriber> subscribers;
  for (int race = 0; race < count; ++race)
  {
    std_msgs::String topic;
    topic.data = "/race_" + prefix + std::to_string(race);
    missing.insert(topic.data);
    subscribers.push_back(node.subscribe<std_msgs::String>(
        topic.data, 1, [&missing](const std_msgs::StringConstPtr& message) { missing.erase(message->data); }));
    races.publish(topic);
    serve();
  }
  const ros::WallTime last = ros::WallTime::now();
  while (!missing.empty() && (ros::WallTime::now() - last).toSec() < patience_s)
  {
    serve();
  }
  return missing.size();
}

TEST(LatchedPublisher, ReachesWhoConnectsWhileItPublishes)
{
  EXPECT_EQ(0u, losses("ours_", RACES, PATIENCE_S));
}

TEST(LatchedPublisher, TheRaceIsThere)
{
  EXPECT_GT(losses("plain_", 5, 5.0), 0u) << "roscpp has mended it: then LatchedPublisher is not needed any more";
}

}  // namespace

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "latched_publisher_test");
  const ros::NodeHandle node;
  return RUN_ALL_TESTS();
}
