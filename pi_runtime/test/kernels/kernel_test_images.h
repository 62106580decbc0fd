#pragma once

#include <opencv2/imgproc.hpp>

#include <pi_runtime/buffer.h>
#include "kernels/kernel_pictures.h"

namespace pi_runtime
{

enum class Content
{
  RANDOM,
  CONSTANT,
  GRADIENT,
  NATURAL,  ///< pictureWithCorners()
};

/// A picture with filled rectangles of every brightness: smooth texture, edges and corners.
inline cv::Mat pictureWithCorners(int width, int height, int seed = 1)
{
  cv::Mat image = makePicture(width, height, 1, seed);
  cv::RNG rng(seed);
  for (int i = 0; i < width * height / 5000; ++i)
  {
    const cv::Point corner{rng.uniform(0, width), rng.uniform(0, height)};
    const cv::Size size{rng.uniform(8, 60), rng.uniform(8, 60)};
    cv::rectangle(image, cv::Rect(corner, size), cv::Scalar(rng.uniform(0, 255)), cv::FILLED);
  }
  cv::GaussianBlur(image, image, cv::Size(3, 3), 0);
  return image;
}

inline cv::Mat makeImage(Content content, int width, int height, int seed = 1)
{
  if (content == Content::NATURAL)
  {
    return pictureWithCorners(width, height, seed);
  }
  cv::Mat image(height, width, CV_8UC1, cv::Scalar(77));
  if (content == Content::RANDOM)
  {
    cv::RNG rng(seed);
    rng.fill(image, cv::RNG::UNIFORM, 0, 256);
  }
  if (content == Content::GRADIENT)
  {
    for (int y = 0; y < height; ++y)
    {
      for (int x = 0; x < width; ++x)
      {
        image.at<uint8_t>(y, x) = static_cast<uint8_t>(x + 2 * y);
      }
    }
  }
  return image;
}

/// The same pixels with `gap` bytes between the rows.
inline cv::Mat withGaps(const cv::Mat& image, int gap)
{
  cv::Mat wide(image.rows, image.cols + gap, image.type(), cv::Scalar::all(0xa5));
  cv::Mat rows = wide.colRange(0, image.cols);
  image.copyTo(rows);
  return rows;
}

/// The rows of a buffer as an image of 8 bits, one channel.
inline cv::Mat toImage(const BufferPtr& buffer, int width, int height, size_t stride, size_t offset = 0)
{
  return cv::Mat(height, width, CV_8UC1, buffer->hostAs<uint8_t>(Access::READ) + offset, stride).clone();
}

/// Number of pixels that differ.
inline int differences(const cv::Mat& a, const cv::Mat& b)
{
  return a.size() == b.size() ? cv::countNonZero(a != b) : -1;
}

}  // namespace pi_runtime
