#pragma once

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include <string>

namespace pi_vehicle
{

/// The left half has the number of the picture as its grey value, the right one 100 more.
inline cv::Mat numberedPicture(int number, cv::Size size)
{
  cv::Mat picture(size, CV_8UC3, cv::Scalar::all(number));
  picture.colRange(size.width / 2, size.width).setTo(cv::Scalar::all(number + 100));
  return picture;
}

/// Pictures 0.png, 1.png and so on. @return the pattern of their names.
inline std::string writeSequence(const std::string& folder, int count, cv::Size size = {64, 24})
{
  for (int i = 0; i < count; ++i)
  {
    EXPECT_TRUE(cv::imwrite(folder + "/" + std::to_string(i) + ".png", numberedPicture(i, size)));
  }
  return folder + "/%d.png";
}

inline std::string writeVideo(const std::string& file, int count, double frame_rate, cv::Size size = {64, 48})
{
  cv::VideoWriter writer(file, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), frame_rate, size);
  EXPECT_TRUE(writer.isOpened());
  for (int i = 0; i < count; ++i)
  {
    writer.write(numberedPicture(i, size));
  }
  return file;
}

}  // namespace pi_vehicle
