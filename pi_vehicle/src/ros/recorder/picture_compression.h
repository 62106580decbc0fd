#pragma once

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

namespace pi_vehicle::recorder
{

/// A picture as JPEG, in the format of image_transport's `compressed`. @param quality  in [1, 100].
/// @throws std::invalid_argument if the encoding is none of mono8, bgr8 and rgb8, or the size does not fit the data.
sensor_msgs::CompressedImage toJpeg(const sensor_msgs::Image& picture, int quality);

}  // namespace pi_vehicle::recorder
