// Tutorial: draws images in the memory where subscribers read them. See the README.

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <opencv2/imgproc.hpp>

#include <string>
#include <utility>

#include "pi_os_transport/zero_copy/publisher.h"
#include "pi_os_transport/zero_copy/shared_image.h"

namespace zero_copy = pi_os_transport::zero_copy;

int main(int argc, char** argv)
{
  ros::init(argc, argv, "camera_zero_copy");
  ros::NodeHandle node;
  const zero_copy::Publisher<sensor_msgs::Image> publisher(node, "image", 2);
  ros::Rate rate(ros::NodeHandle("~").param("rate", 30.0));
  for (int number = 0; ros::ok(); ++number)
  {
    zero_copy::Loan<sensor_msgs::Image> image = publisher.borrow();
    image->header.stamp = ros::Time::now();
    image->header.frame_id = "camera_optical";
    cv::Mat picture = zero_copy::resizeImage(image.get(), 1080, 1920, "bgr8");
    picture.setTo(cv::Scalar(40, 40, 40));
    cv::putText(picture, std::to_string(number), {100, 600}, cv::FONT_HERSHEY_SIMPLEX, 12, {0, 200, 255}, 20);
    publisher.publish(std::move(image));
    ros::spinOnce();
    rate.sleep();
  }
  return 0;
}
