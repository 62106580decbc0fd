#include <ros/ros.h>
#include <std_msgs/String.h>

#include <string>

int main(int argc, char** argv)
{
  ros::init(argc, argv, "talker");
  ros::NodeHandle node;
  const ros::Publisher publisher = node.advertise<std_msgs::String>("words", 10);
  ros::Rate rate(20.0);
  for (int number = 0; ros::ok(); ++number)
  {
    std_msgs::String word;
    word.data = "word " + std::to_string(number);
    publisher.publish(word);
    rate.sleep();
  }
  return 0;
}
