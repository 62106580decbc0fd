#include "ros/sensors/stereo_pictures.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/vehicle_clock.h>
#include <pi_os_transport/zero_copy/cv_bridge.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <sensor_msgs/image_encodings.h>

#include <opencv2/imgproc.hpp>

#include <utility>

namespace pi_vehicle
{

namespace zero_copy = pi_os_transport::zero_copy;
using pi_node::sizeText;

namespace
{

constexpr uint32_t PICTURE_QUEUE = 4;

std::string toUrl(const std::string& calibration)
{
  return calibration.empty() || calibration.front() != '/' ? calibration : "file://" + calibration;
}

ros::Time toStamp(int64_t monotonic_ns)
{
  return pi_node::rosTime(pi_node::vehicleNs() - (pi_node::monotonicNs() - monotonic_ns));
}

}  // namespace

StereoPictures::StereoPictures(ros::NodeHandle node, const StereoCameraRosOptions& options,
                               pi_node::WarningBoard* warnings)
  : options_(options), warnings_(*warnings)
{
  const std::array<std::string, 2> names = {"left", "right"};
  for (size_t i = 0; i < sides_.size(); ++i)
  {
    Side& side = sides_[i];
    side.name = names[i];
    side.frame = i == 0 ? options_.left_frame : options_.right_frame;
    side.pictures = {node, side.name + "/image_raw", PICTURE_QUEUE};
    side.infos = node.advertise<sensor_msgs::CameraInfo>(side.name + "/camera_info", PICTURE_QUEUE);
    side.calibration = std::make_unique<camera_info_manager::CameraInfoManager>(
        ros::NodeHandle(node, side.name), side.name,
        toUrl(i == 0 ? options_.left_calibration : options_.right_calibration));
  }
}

ros::Time StereoPictures::publish(const VideoPicture& left, const VideoPicture& right)
{
  // Both are published together, so a subscriber waits only a little for the second one.
  std::array<zero_copy::Loan<sensor_msgs::Image>, 2> images = {toImage(sides_[0], left.picture),
                                                               toImage(sides_[1], right.picture)};
  const ros::Time stamp = toStamp(left.stamp_ns);
  images[0]->header.stamp = stamp;
  images[1]->header.stamp = stamp + ros::Duration().fromNSec(right.stamp_ns - left.stamp_ns);
  for (size_t i = 0; i < sides_.size(); ++i)
  {
    sensor_msgs::CameraInfo info = cameraInfo(sides_[i], left.picture.cols, left.picture.rows);
    info.header = zero_copy::standardHeader(images[i]->header);
    sides_[i].infos.publish(info);
    sides_[i].pictures.publish(std::move(images[i]));
  }
  return stamp;
}

zero_copy::Loan<sensor_msgs::Image> StereoPictures::toImage(const Side& side, const cv::Mat& picture) const
{
  namespace encodings = sensor_msgs::image_encodings;
  zero_copy::Loan<sensor_msgs::Image> image = side.pictures.borrow();
  image->header.frame_id = side.frame;
  cv::Mat target = zero_copy::resizeImage(image.get(), picture.rows, picture.cols,
                                          options_.color ? encodings::BGR8 : encodings::MONO8);
  const int channels = picture.channels();
  if (channels == target.channels())
  {
    picture.copyTo(target);
  }
  else
  {
    const int code = options_.color ? (channels == 1 ? cv::COLOR_GRAY2BGR : cv::COLOR_BGRA2BGR)
                                    : (channels == 3 ? cv::COLOR_BGR2GRAY : cv::COLOR_BGRA2GRAY);
    cv::cvtColor(picture, target, code);
  }
  return image;
}

/// Without a calibration that fits: only the size, as sensor_msgs/CameraInfo tells uncalibrated cameras.
sensor_msgs::CameraInfo StereoPictures::cameraInfo(const Side& side, int width, int height) const
{
  sensor_msgs::CameraInfo info = side.calibration->getCameraInfo();
  const auto columns = static_cast<uint32_t>(width);
  const auto rows = static_cast<uint32_t>(height);
  if (info.width != columns || info.height != rows)
  {
    if (side.calibration->isCalibrated())
    {
      warnings_.error("the calibration of the " + side.name + " camera is for " + sizeText(info.width, info.height) +
                      ", its pictures are " + sizeText(width, height) + "; calibrate anew, or set width and height");
    }
    info = sensor_msgs::CameraInfo();
    info.width = columns;
    info.height = rows;
  }
  if (info.K[0] == 0.0)
  {
    warnings_.warn("the " + side.name + " camera is not calibrated; set " + side.name + "_calibration, or call " +
                   side.name + "/set_camera_info");
  }
  return info;
}

}  // namespace pi_vehicle
