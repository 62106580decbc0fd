#include <ros/ros.h>
#include <std_msgs/String.h>

void onWord(const std_msgs::StringConstPtr& word)
{
  ROS_INFO_THROTTLE(1.0, "heard: %s", word->data.c_str());
}

int main(int argc, char** argv)
{
  ros::init(argc, argv, "listener");
  ros::NodeHandle node;
  const ros::Subscriber subscriber = node.subscribe("words", 10, onWord);
  ros::spin();
  return 0;
}
