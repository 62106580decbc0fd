#pragma once

#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <string>

namespace pi_detect
{

/// Side of the test pictures; the tiny network divides them into 4 x 4 cells.
constexpr uint32_t SIDE_PX = 128;
constexpr uint32_t CELL_PX = SIDE_PX / 4;

/// A dark picture, bright in one cell, in which the tiny network finds "bright".
/// @param column, row  of the cell; -1: dark everywhere.
inline sensor_msgs::ImagePtr makePicture(const ros::Time& stamp, int column, int row)
{
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp = stamp;
  image->header.frame_id = "camera_optical";
  image->encoding = sensor_msgs::image_encodings::MONO8;
  image->width = image->height = image->step = SIDE_PX;
  image->data.assign(SIDE_PX * SIDE_PX, 0);
  for (uint32_t y = 0; y < SIDE_PX; ++y)
  {
    for (uint32_t x = 0; x < SIDE_PX; ++x)
    {
      if (static_cast<int>(x / CELL_PX) == column && static_cast<int>(y / CELL_PX) == row)
      {
        image->data[y * SIDE_PX + x] = 255;
      }
    }
  }
  return image;
}

/// Publishes pictures as a camera does, in place of its driver.
class CameraOnGraph
{
public:
  CameraOnGraph() : publisher_(node_.advertise<sensor_msgs::Image>("image", 1000)) {}

  uint32_t listeners() const { return publisher_.getNumSubscribers(); }
  /// Stamps grow by 0.1 s from picture to picture, in all tests of a program.
  ros::Time nextStamp()
  {
    static double stamp_s = 1000.0;
    stamp_s += 0.1;
    return ros::Time(stamp_s);
  }
  /// @return its stamp.
  ros::Time show(int column, int row)
  {
    const ros::Time stamp = nextStamp();
    publisher_.publish(makePicture(stamp, column, row));
    return stamp;
  }
  void publish(const sensor_msgs::ImageConstPtr& image) { publisher_.publish(image); }

private:
  ros::NodeHandle node_;
  ros::Publisher publisher_;
};

}  // namespace pi_detect
