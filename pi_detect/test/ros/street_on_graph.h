#pragma once

#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <stereo_msgs/DisparityImage.h>

#include <opencv2/core/mat.hpp>

namespace pi_detect
{

/// A textured ground with a wall at 12 m and a box before it, as a rectified stereo pair sees them.
struct RenderedStreet
{
  static constexpr int WIDTH_PX = 640;
  static constexpr int HEIGHT_PX = 400;
  static constexpr double FOCAL_PX = 400.0;
  static constexpr double BASELINE_M = 0.2;
  static constexpr double CAMERA_HEIGHT_M = 1.0;  ///< left camera above base_link, looking along x

  cv::Mat left;
  cv::Mat right;
  cv::Mat disparity;  ///< true one, CV_32FC1

  /// @param box_x  of the box's front [m]; it is 1 m wide around y = 0 and 1.2 m high.
  static RenderedStreet make(double box_x);
};

/// Publishes the street as cameras do, in place of their drivers; its tf has base_link -> left_optical.
class StreetOnGraph
{
public:
  StreetOnGraph();

  /// @return the stamp; they grow by 0.1 s from pair to pair, in all tests of a program.
  ros::Time showPair(const RenderedStreet& street);
  ros::Time showDisparity(const RenderedStreet& street, double min_depth_m = 1.0);
  /// The same with P of both cameras exchanged.
  ros::Time showSwapped(const RenderedStreet& street);

  uint32_t listeners() const { return images_[0].getNumSubscribers(); }
  bool waitForPairListeners() const;
  bool waitForDisparityListeners() const;

private:
  ros::NodeHandle node_;
  ros::Publisher images_[2];
  ros::Publisher infos_[2];
  ros::Publisher disparity_;
};

/// Broadcasts odom -> base_link, as it was at a stamp.
void broadcastOdom(const ros::Time& stamp, double x);

}  // namespace pi_detect
