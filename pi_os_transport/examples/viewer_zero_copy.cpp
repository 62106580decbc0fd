// Tutorial: reads images in the memory where their publisher wrote them. See the README.

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>

#include <iostream>

#include "pi_os_transport/zero_copy/shared_image.h"
#include "pi_os_transport/zero_copy/statistics.h"
#include "pi_os_transport/zero_copy/subscriber.h"

namespace zero_copy = pi_os_transport::zero_copy;

void onImage(const zero_copy::ConstPtr<sensor_msgs::Image>& image)
{
  const cv::Mat picture = zero_copy::shareMat(image);  // keeps the image, like every copy of the matrix
  const cv::Scalar mean = cv::mean(picture);
  ROS_INFO_THROTTLE(1.0, "%ux%u from %s, %s: mean %.1f %.1f %.1f", image->width, image->height,
                    image->header.frame_id.c_str(), zero_copy::isView(image->data) ? "not copied" : "copied", mean[0],
                    mean[1], mean[2]);
}

int main(int argc, char** argv)
{
  ros::init(argc, argv, "viewer_zero_copy");
  ros::NodeHandle node;
  const ros::Subscriber subscriber = node.subscribe("image", 2, onImage);
  ros::spin();
  for (const zero_copy::TopicStatistics& topic : zero_copy::statistics())
  {
    std::cout << topic.toString() << std::endl;  // not by ROS_INFO: ROS has shut down
  }
  return 0;
}
