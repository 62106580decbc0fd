#pragma once

#include <pi_detect/detector.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <sensor_msgs/Image.h>

#include <opencv2/core/mat.hpp>

namespace pi_detect
{

/// The picture of a message, for the detector. mono8, 8UC1, bgr8, 8UC3 (taken as BGR) and rgb8 are used without a copy;
/// bgra8, rgba8, mono16, bayer_* and yuv422 are converted. Keeps the message or the converted picture alive.
class MessagePicture
{
public:
  /// @throws std::invalid_argument for an encoding that is unknown, a size of zero, a step that is too small, and fewer
  ///         bytes than size and step ask for.
  explicit MessagePicture(pi_os_transport::zero_copy::ImageHandle message);
  explicit MessagePicture(const sensor_msgs::ImageConstPtr& message);

  const PictureView& view() const { return view_; }
  const pi_os_transport::zero_copy::Message<sensor_msgs::Image>& message() const { return *message_; }

private:
  pi_os_transport::zero_copy::ImageHandle message_;
  cv::Mat converted_;  ///< empty: the view is of the message
  PictureView view_;
};

/// In grey levels, CV_8UC1. mono8 and 8UC1 share the message's buffer, which must live as long and is not written to.
/// @throws std::invalid_argument as above.
cv::Mat toGrey(const sensor_msgs::Image& message);
cv::Mat toGrey(const pi_os_transport::zero_copy::Message<sensor_msgs::Image>& message);

}  // namespace pi_detect
