#include <pi_detect/ros/message_picture.h>
#include <pi_node/formatting.h>
#include <pi_os_transport/zero_copy/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/shared_ptr.hpp>
#include <exception>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace pi_detect
{
namespace
{

using pi_node::sizeText;

namespace encodings = sensor_msgs::image_encodings;
namespace zero_copy = pi_os_transport::zero_copy;
using Format = PictureView::Format;

constexpr uint32_t MAX_SIDE_PX = 16384;

[[noreturn]] void refuseEncoding(const std::string& encoding, const std::string& why)
{
  throw std::invalid_argument("encoding \"" + encoding +
                              "\" is no picture; known are mono8, bgr8, rgb8, 8UC1, 8UC3, bgra8, rgba8, mono16, "
                              "bayer_* and yuv422" +
                              why);
}

/// What needs no conversion.
std::optional<Format> formatOf(const std::string& encoding)
{
  if (encoding == encodings::MONO8 || encoding == encodings::TYPE_8UC1)
  {
    return Format::MONO8;
  }
  if (encoding == encodings::BGR8 || encoding == encodings::TYPE_8UC3)
  {
    return Format::BGR8;
  }
  if (encoding == encodings::RGB8)
  {
    return Format::RGB8;
  }
  return std::nullopt;
}

bool isConvertible(const std::string& encoding)
{
  return encoding == encodings::BGRA8 || encoding == encodings::RGBA8 || encoding == encodings::MONO16 ||
         encoding == encodings::YUV422 || encodings::isBayer(encoding);
}

uint32_t bytesPerPixel(const std::string& encoding)
{
  if (encoding == encodings::YUV422)
  {
    return 2;
  }
  return static_cast<uint32_t>(encodings::numChannels(encoding) * encodings::bitDepth(encoding) / 8);
}

template <typename A>
void check(const sensor_msgs::Image_<A>& message)
{
  if (!formatOf(message.encoding) && !isConvertible(message.encoding))
  {
    refuseEncoding(message.encoding, "");
  }
  if (message.width == 0 || message.height == 0 || message.width > MAX_SIDE_PX || message.height > MAX_SIDE_PX)
  {
    throw std::invalid_argument("size " + sizeText(message.width, message.height) + ", must be 1x1 to " +
                                sizeText(MAX_SIDE_PX, MAX_SIDE_PX));
  }
  const uint32_t row = message.width * bytesPerPixel(message.encoding);
  if (message.step < row)
  {
    throw std::invalid_argument("step " + std::to_string(message.step) + ", must be at least " + std::to_string(row) +
                                " bytes for " + std::to_string(message.width) + " pixels of " + message.encoding);
  }
  if (static_cast<size_t>(message.step) * message.height > message.data.size())
  {
    throw std::invalid_argument("step " + std::to_string(message.step) + " and height " +
                                std::to_string(message.height) + " need more than its " +
                                std::to_string(message.data.size()) + " bytes");
  }
}

template <typename A>
cv::Mat convert(const sensor_msgs::Image_<A>& message, const std::string& encoding)
{
  try
  {
    return zero_copy::toCvCopy(message, encoding)->image;
  }
  // cv_bridge throws runtime errors of several kinds, and OpenCV's for sizes that a pattern does not allow.
  catch (const std::exception& error)
  {
    refuseEncoding(message.encoding, std::string(" (") + error.what() + ")");
  }
}

/// mono16 in 8 bits.
template <typename A>
cv::Mat shallow(const sensor_msgs::Image_<A>& message, UsedBits* used_bits)
{
  const cv::Mat deep = convert(message, encodings::MONO16);
  UsedBits own;
  const int bits = (used_bits == nullptr ? own : *used_bits).add(deep);
  cv::Mat grey;
  deep.convertTo(grey, CV_8U, 255.0 / ((1 << bits) - 1));
  return grey;
}

template <typename A>
cv::Mat greyLevels(const sensor_msgs::Image_<A>& message, UsedBits* used_bits)
{
  check(message);
  if (formatOf(message.encoding) == Format::MONO8)
  {
    // OpenCV knows no constant pictures.
    return cv::Mat(static_cast<int>(message.height), static_cast<int>(message.width), CV_8UC1,
                   const_cast<uint8_t*>(message.data.data()), message.step);
  }
  if (message.encoding == encodings::TYPE_8UC3)
  {
    cv::Mat grey;
    cv::cvtColor(cv::Mat(static_cast<int>(message.height), static_cast<int>(message.width), CV_8UC3,
                         const_cast<uint8_t*>(message.data.data()), message.step),
                 grey, cv::COLOR_BGR2GRAY);
    return grey;
  }
  return message.encoding == encodings::MONO16 ? shallow(message, used_bits) : convert(message, encodings::MONO8);
}

}  // namespace

int UsedBits::add(const cv::Mat& deep)
{
  double most = 0.0;
  cv::minMaxLoc(deep, nullptr, &most);
  while (bits_ < 16 && most >= 1 << bits_)
  {
    bits_ += 2;
  }
  return bits_;
}

MessagePicture::MessagePicture(const sensor_msgs::ImageConstPtr& message, UsedBits* used_bits)
  : MessagePicture(zero_copy::toHandle(message), used_bits)
{
}

MessagePicture::MessagePicture(zero_copy::ImageHandle message, UsedBits* used_bits) : message_(std::move(message))
{
  check(*message_);
  if (const std::optional<Format> format = formatOf(message_->encoding))
  {
    view_ = {message_->data.data(), static_cast<int>(message_->width), static_cast<int>(message_->height),
             message_->step, *format};
    return;
  }
  const bool grey = message_->encoding == encodings::MONO16;
  converted_ = grey ? shallow(*message_, used_bits) : convert(*message_, encodings::BGR8);
  view_ = {converted_.data, converted_.cols, converted_.rows, converted_.step[0], grey ? Format::MONO8 : Format::BGR8};
}

cv::Mat toGrey(const sensor_msgs::Image& message, UsedBits* used_bits)
{
  return greyLevels(message, used_bits);
}

cv::Mat toGrey(const zero_copy::Message<sensor_msgs::Image>& message, UsedBits* used_bits)
{
  return greyLevels(message, used_bits);
}

}  // namespace pi_detect
