#include "ros/recorder/picture_compression.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>

#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

namespace pi_vehicle::recorder
{
namespace
{

using pi_node::test_support::messageOf;

constexpr int QUALITY = 80;
constexpr int NEAR = 4;  // of 255: the loss of JPEG on a plain picture

sensor_msgs::Image plain(const std::string& encoding, const std::vector<uint8_t>& pixel, uint32_t padding = 0)
{
  sensor_msgs::Image picture;
  picture.header.frame_id = "camera";
  picture.encoding = encoding;
  picture.width = 32;
  picture.height = 16;
  picture.step = 32 * static_cast<uint32_t>(pixel.size()) + padding;
  picture.data.assign(picture.step * picture.height, 255);
  for (uint32_t y = 0; y < picture.height; ++y)
  {
    for (uint32_t x = 0; x < picture.width; ++x)
    {
      std::copy(pixel.begin(), pixel.end(), picture.data.begin() + y * picture.step + x * pixel.size());
    }
  }
  return picture;
}

TEST(PictureCompression, MonoStaysMono)
{
  const sensor_msgs::CompressedImage jpeg = toJpeg(plain("mono8", {100}, 8), QUALITY);
  EXPECT_EQ("mono8; jpeg compressed mono8", jpeg.format);
  EXPECT_EQ("camera", jpeg.header.frame_id);
  const cv::Mat decoded = cv::imdecode(jpeg.data, cv::IMREAD_UNCHANGED);
  ASSERT_EQ(cv::Size(32, 16), decoded.size());
  ASSERT_EQ(1, decoded.channels());
  EXPECT_NEAR(100, decoded.at<uint8_t>(15, 31), NEAR);
}

TEST(PictureCompression, ColoursKeepTheirOrder)
{
  for (const auto& [encoding, pixel] : {std::make_pair("bgr8", std::vector<uint8_t>{200, 100, 10}),
                                        std::make_pair("rgb8", std::vector<uint8_t>{10, 100, 200})})
  {
    const sensor_msgs::CompressedImage jpeg = toJpeg(plain(encoding, pixel), QUALITY);
    EXPECT_EQ(std::string(encoding) + "; jpeg compressed bgr8", jpeg.format);
    const cv::Vec3b decoded = cv::imdecode(jpeg.data, cv::IMREAD_COLOR).at<cv::Vec3b>(8, 8);
    EXPECT_NEAR(200, decoded[0], NEAR) << encoding;
    EXPECT_NEAR(10, decoded[2], NEAR) << encoding;
  }
}

TEST(PictureCompression, RefusesOtherEncodingsAndWrongSizes)
{
  EXPECT_EQ("encoding 16UC1, must be mono8, bgr8 or rgb8", messageOf<std::invalid_argument>(
                                                               [] {
                                                                 toJpeg(plain("16UC1", {0, 0}), QUALITY);
                                                               }));
  sensor_msgs::Image cut = plain("mono8", {100});
  cut.data.resize(100);
  EXPECT_EQ("32x16 with 100 bytes, must be that many pixels",
            messageOf<std::invalid_argument>([&] { toJpeg(cut, QUALITY); }));
  cut.step = 0;
  EXPECT_NE("", messageOf<std::invalid_argument>([&] { toJpeg(cut, QUALITY); }));
  EXPECT_NE("", messageOf<std::invalid_argument>([] { toJpeg(sensor_msgs::Image(), QUALITY); }));
}

}  // namespace
}  // namespace pi_vehicle::recorder
