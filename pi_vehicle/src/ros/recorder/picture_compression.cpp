#include "ros/recorder/picture_compression.h"

#include <sensor_msgs/image_encodings.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace pi_vehicle::recorder
{

sensor_msgs::CompressedImage toJpeg(const sensor_msgs::Image& picture, int quality)
{
  namespace encodings = sensor_msgs::image_encodings;
  const bool mono = picture.encoding == encodings::MONO8;
  if (!mono && picture.encoding != encodings::BGR8 && picture.encoding != encodings::RGB8)
  {
    throw std::invalid_argument("encoding " + picture.encoding + ", must be mono8, bgr8 or rgb8");
  }
  const size_t row = static_cast<size_t>(picture.width) * (mono ? 1 : 3);
  if (picture.width == 0 || picture.height == 0 || picture.step < row ||
      picture.data.size() / picture.step < picture.height)
  {
    throw std::invalid_argument(std::to_string(picture.width) + "x" + std::to_string(picture.height) + " with " +
                                std::to_string(picture.data.size()) + " bytes, must be that many pixels");
  }
  // OpenCV has no picture of constant data; imencode only reads.
  const cv::Mat pixels(static_cast<int>(picture.height), static_cast<int>(picture.width), mono ? CV_8UC1 : CV_8UC3,
                       const_cast<uint8_t*>(picture.data.data()), picture.step);
  cv::Mat swapped;
  if (picture.encoding == encodings::RGB8)
  {
    cv::cvtColor(pixels, swapped, cv::COLOR_RGB2BGR);
  }
  sensor_msgs::CompressedImage jpeg;
  jpeg.header = picture.header;
  jpeg.format = picture.encoding + "; jpeg compressed " + (mono ? encodings::MONO8 : encodings::BGR8);
  cv::imencode(".jpg", swapped.empty() ? pixels : swapped, jpeg.data, {cv::IMWRITE_JPEG_QUALITY, quality});
  return jpeg;
}

}  // namespace pi_vehicle::recorder
