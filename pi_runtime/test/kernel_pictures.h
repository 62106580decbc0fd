#pragma once

#include <memory>
#include <opencv2/imgproc.hpp>

#include <pi_runtime/buffer.h>

namespace pi_runtime
{

/// A picture with structure of several sizes and a little noise, the same for the same arguments.
inline cv::Mat makePicture(int width, int height, int channels, uint64_t seed = 7)
{
  cv::RNG random(seed);
  cv::Mat sum(height, width, CV_32FC(channels), cv::Scalar::all(0));
  for (const int cell : {64, 24, 9})
  {
    cv::Mat coarse(height / cell + 3, width / cell + 3, CV_32FC(channels));
    random.fill(coarse, cv::RNG::UNIFORM, 0, 5 * cell);
    cv::Mat fine;
    cv::resize(coarse, fine, cv::Size(), cell, cell, cv::INTER_LINEAR);
    sum += fine(cv::Rect(cell / 2, cell / 2, width, height));
  }
  cv::Mat noise(height, width, CV_32FC(channels));
  random.fill(noise, cv::RNG::NORMAL, 0, 2);
  cv::Mat picture;
  cv::Mat(sum + noise).convertTo(picture, CV_8U, 0.55, -10);
  return picture;
}

/// The matrix as a buffer, which keeps it alive. From the first to the last row, so padding between them included.
inline BufferPtr wrapMat(const cv::Mat& mat)
{
  const auto owner = std::make_shared<const cv::Mat>(mat);
  const size_t bytes = (mat.rows - 1) * mat.step[0] + mat.cols * mat.elemSize();
  return Buffer::wrap(static_cast<void*>(mat.data), bytes, owner);
}

}  // namespace pi_runtime
