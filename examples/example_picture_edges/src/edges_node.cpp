// Takes pictures where their publisher wrote them, and draws their edges where subscribers read them.

#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/UInt32.h>

#include <opencv2/imgproc.hpp>

#include <utility>

#include <pi_os_transport/zero_copy/publisher.h>
#include <pi_os_transport/zero_copy/shared_image.h>
#include <pi_os_transport/zero_copy/subscriber.h>

namespace zero_copy = pi_os_transport::zero_copy;

int main(int argc, char** argv)
{
  ros::init(argc, argv, "edges");
  ros::NodeHandle node;
  const zero_copy::Publisher<sensor_msgs::Image> edges(node, "edges", 2);
  const ros::Publisher views = node.advertise<std_msgs::UInt32>("views", 1, true);
  std_msgs::UInt32 not_copied;

  const boost::function<void(const zero_copy::ConstPtr<sensor_msgs::Image>&)> on_image =
      [&](const zero_copy::ConstPtr<sensor_msgs::Image>& image)
  {
    not_copied.data += zero_copy::isView(image->data) ? 1U : 0U;
    views.publish(not_copied);

    cv::Mat grey;
    cv::cvtColor(zero_copy::shareMat(image), grey, cv::COLOR_BGR2GRAY);
    zero_copy::Loan<sensor_msgs::Image> out = edges.borrow();
    out->header = image->header;
    cv::Mat drawn = zero_copy::resizeImage(out.get(), grey.rows, grey.cols, "mono8");
    cv::Sobel(grey, drawn, CV_8U, 1, 1);
    edges.publish(std::move(out));
  };
  const ros::Subscriber subscriber = node.subscribe<zero_copy::Message<sensor_msgs::Image>>("image", 2, on_image);
  ros::spin();
  return 0;
}
