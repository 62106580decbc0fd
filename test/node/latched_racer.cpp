// The publishing side of latched_publisher.test: for each topic on /race it advertises that topic and publishes its name
// once. Topics named *plain* have a publisher of roscpp.

#include <pi_node/ros/latched_publisher.h>
#include <ros/ros.h>
#include <std_msgs/String.h>

#include <string>
#include <vector>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "racer");
  ros::NodeHandle node;
  std::vector<ros::Publisher> plain;
  std::vector<pi_node::LatchedPublisher<std_msgs::String>> ours;
  const auto race = [&](const std_msgs::StringConstPtr& topic)
  {
    if (topic->data.find("plain") != std::string::npos)
    {
      plain.push_back(node.advertise<std_msgs::String>(topic->data, 1, true));
      plain.back().publish(*topic);
    }
    else
    {
      ours.emplace_back(node, topic->data, 1);
      ours.back().publish(*topic);
    }
  };
  const ros::Subscriber races = node.subscribe<std_msgs::String>("/race", 1000, race);
  ros::spin();
  return 0;
}
