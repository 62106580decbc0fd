#include "ros/street_on_graph.h"

#include <pi_detect/ros/conversions.h>
#include <pi_node/test_support/on_graph.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

constexpr double WALL_X = 12.0;
constexpr double BOX_HALF_WIDTH_M = 0.5;
constexpr double BOX_HEIGHT_M = 1.2;
const char* const FRAMES[2] = {"left_optical", "right_optical"};

double lattice(int x, int y)
{
  uint32_t hash = static_cast<uint32_t>(x) * 0x9E3779B1u ^ static_cast<uint32_t>(y) * 0x85EBCA77u;
  hash ^= hash >> 15;
  hash *= 0x2C1B3C6Du;
  hash ^= hash >> 13;
  return static_cast<double>(hash & 0xFFFFu) / 65535.0;
}

/// Smooth noise, 0 to 1. @param grain  distance of its points [m].
double noise(double x, double y, double grain)
{
  x /= grain;
  y /= grain;
  const int column = static_cast<int>(std::floor(x));
  const int row = static_cast<int>(std::floor(y));
  const double fx = x - column;
  const double fy = y - row;
  const double top = lattice(column, row) * (1.0 - fx) + lattice(column + 1, row) * fx;
  const double bottom = lattice(column, row + 1) * (1.0 - fx) + lattice(column + 1, row + 1) * fx;
  return top * (1.0 - fy) + bottom * fy;
}

double texture(double x, double y)
{
  return 0.4 * noise(x, y, 0.04) + 0.3 * noise(x + 50.0, y, 0.12) + 0.3 * noise(x, y + 90.0, 0.5);
}

struct Seen
{
  double distance;  ///< along x of base_link, from the camera [m]
  double grey;
};

/// @param camera_y  of the camera in base_link; at x = 0. @param y, z  of the ray, per x.
Seen look(double camera_y, double y, double z, double box_x)
{
  Seen seen{WALL_X, texture(camera_y + WALL_X * y + 300.0, WALL_X * z)};
  if (z < 0.0 && -RenderedStreet::CAMERA_HEIGHT_M / z < seen.distance)
  {
    const double x = -RenderedStreet::CAMERA_HEIGHT_M / z;
    seen = {x, texture(x, camera_y + x * y)};
  }
  const double box_y = camera_y + box_x * y;
  const double box_z = RenderedStreet::CAMERA_HEIGHT_M + box_x * z;
  if (box_x < seen.distance && std::abs(box_y) <= BOX_HALF_WIDTH_M && box_z <= BOX_HEIGHT_M && box_z >= 0.0)
  {
    seen = {box_x, texture(box_y + 100.0, box_z)};
  }
  return seen;
}

sensor_msgs::CameraInfo makeInfo(bool right, const ros::Time& stamp)
{
  constexpr double f = RenderedStreet::FOCAL_PX;
  constexpr double cx = 0.5 * RenderedStreet::WIDTH_PX;
  constexpr double cy = 0.5 * RenderedStreet::HEIGHT_PX;
  sensor_msgs::CameraInfo info;
  info.header.stamp = stamp;
  info.header.frame_id = FRAMES[right ? 1 : 0];
  info.width = RenderedStreet::WIDTH_PX;
  info.height = RenderedStreet::HEIGHT_PX;
  info.distortion_model = "plumb_bob";
  info.D.assign(5, 0.0);
  info.K = {f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {f, 0.0, cx, right ? -f * RenderedStreet::BASELINE_M : 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

std_msgs::Header makeHeader(int camera, const ros::Time& stamp)
{
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = FRAMES[camera];
  return header;
}

ros::Time nextStamp()
{
  static double stamp_s = 1000.0;
  stamp_s += 0.1;
  return ros::Time(stamp_s);
}

}  // namespace

RenderedStreet RenderedStreet::make(double box_x)
{
  RenderedStreet street;
  street.disparity.create(HEIGHT_PX, WIDTH_PX, CV_32FC1);
  for (cv::Mat* picture : {&street.left, &street.right})
  {
    picture->create(HEIGHT_PX, WIDTH_PX, CV_8UC1);
    const double camera_y = picture == &street.left ? 0.0 : -BASELINE_M;
    for (int v = 0; v < HEIGHT_PX; ++v)
    {
      for (int u = 0; u < WIDTH_PX; ++u)
      {
        // Four rays per pixel, against aliasing far away.
        double grey = 0.0;
        for (const double du : {0.25, 0.75})
        {
          for (const double dv : {0.25, 0.75})
          {
            grey +=
                0.25 *
                look(camera_y, (0.5 * WIDTH_PX - u - du) / FOCAL_PX, (0.5 * HEIGHT_PX - v - dv) / FOCAL_PX, box_x).grey;
          }
        }
        picture->at<uint8_t>(v, u) = static_cast<uint8_t>(std::clamp(20.0 + 220.0 * grey, 0.0, 255.0));
        if (picture == &street.left)
        {
          const Seen seen =
              look(0.0, (0.5 * WIDTH_PX - u - 0.5) / FOCAL_PX, (0.5 * HEIGHT_PX - v - 0.5) / FOCAL_PX, box_x);
          street.disparity.at<float>(v, u) = static_cast<float>(FOCAL_PX * BASELINE_M / seen.distance);
        }
      }
    }
  }
  return street;
}

StreetOnGraph::StreetOnGraph()
{
  for (const int camera : {0, 1})
  {
    const std::string side = camera == 0 ? "left" : "right";
    images_[camera] = node_.advertise<sensor_msgs::Image>(side + "/image_rect", 10);
    infos_[camera] = node_.advertise<sensor_msgs::CameraInfo>(side + "/camera_info", 10);
  }
  disparity_ = node_.advertise<stereo_msgs::DisparityImage>("disparity", 10);

  static tf2_ros::StaticTransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped mounting;
  mounting.header.stamp = ros::Time(1.0);
  mounting.header.frame_id = "base_link";
  mounting.child_frame_id = FRAMES[0];
  mounting.transform.translation.z = RenderedStreet::CAMERA_HEIGHT_M;
  // Optical z is x of base_link, optical x is -y, optical y is -z.
  mounting.transform.rotation.x = -0.5;
  mounting.transform.rotation.y = 0.5;
  mounting.transform.rotation.z = -0.5;
  mounting.transform.rotation.w = 0.5;
  broadcaster.sendTransform(mounting);
}

ros::Time StreetOnGraph::showPair(const RenderedStreet& street)
{
  const ros::Time stamp = nextStamp();
  for (const int camera : {0, 1})
  {
    infos_[camera].publish(makeInfo(camera == 1, stamp));
    images_[camera].publish(toImage(camera == 0 ? street.left : street.right, makeHeader(camera, stamp)));
  }
  return stamp;
}

ros::Time StreetOnGraph::showSwapped(const RenderedStreet& street)
{
  const ros::Time stamp = nextStamp();
  for (const int camera : {0, 1})
  {
    infos_[camera].publish(makeInfo(camera == 0, stamp));
    images_[camera].publish(toImage(camera == 0 ? street.left : street.right, makeHeader(camera, stamp)));
  }
  return stamp;
}

ros::Time StreetOnGraph::showDisparity(const RenderedStreet& street, double min_depth_m)
{
  const ros::Time stamp = nextStamp();
  StereoGeometry geometry;
  geometry.fx = RenderedStreet::FOCAL_PX;
  geometry.baseline_m = RenderedStreet::BASELINE_M;
  infos_[0].publish(makeInfo(false, stamp));
  disparity_.publish(toDisparityImage(street.disparity, geometry, min_depth_m, makeHeader(0, stamp)));
  return stamp;
}

bool StreetOnGraph::waitForPairListeners() const
{
  return until(TIMEOUT_S,
               [this]
               {
                 return images_[0].getNumSubscribers() > 0 && images_[1].getNumSubscribers() > 0 &&
                        infos_[0].getNumSubscribers() > 0 && infos_[1].getNumSubscribers() > 0;
               });
}

bool StreetOnGraph::waitForDisparityListeners() const
{
  return until(TIMEOUT_S, [this] { return disparity_.getNumSubscribers() > 0 && infos_[0].getNumSubscribers() > 0; });
}

void broadcastOdom(const ros::Time& stamp, double x)
{
  static tf2_ros::TransformBroadcaster broadcaster;
  geometry_msgs::TransformStamped pose;
  pose.header.stamp = stamp;
  pose.header.frame_id = "odom";
  pose.child_frame_id = "base_link";
  pose.transform.translation.x = x;
  pose.transform.rotation.w = 1.0;
  broadcaster.sendTransform(pose);
}

}  // namespace pi_detect
