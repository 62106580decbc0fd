#include "image_codec/image_conversion.h"

#include <ros/serialization.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "wire/payload.h"

namespace pi_os_transport
{
namespace
{

/// The image cannot be compressed this way (Unsupported), or the data are no image (BadData). The text tells why.
struct Unsupported : std::runtime_error
{
  using std::runtime_error::runtime_error;
};
struct BadData : std::runtime_error
{
  using std::runtime_error::runtime_error;
};

/// How the pixels of an encoding lie in memory, and how they are compressed.
struct PixelFormat
{
  const char* encoding;
  int type;             ///< of OpenCV
  const char* jpeg;     ///< encoding in the format string; null: JPEG cannot carry these pixels
  const char* png;      ///< the same for PNG
  int to_compressed;    ///< conversion before compressing, NONE if there is none
  int from_compressed;  ///< conversion after
  int compressed_type;  ///< of OpenCV, after decoding
};

constexpr int NONE = -1;
constexpr bool HOST_IS_BIG_ENDIAN = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
constexpr PixelFormat FORMATS[] = {
    {"mono8", CV_8UC1, "mono8", "mono8", NONE, NONE, CV_8UC1},
    {"8UC1", CV_8UC1, "mono8", "mono8", NONE, NONE, CV_8UC1},
    {"bgr8", CV_8UC3, "bgr8", "bgr8", NONE, NONE, CV_8UC3},
    {"8UC3", CV_8UC3, "bgr8", "bgr8", NONE, NONE, CV_8UC3},
    {"rgb8", CV_8UC3, "bgr8", "bgr8", cv::COLOR_RGB2BGR, cv::COLOR_BGR2RGB, CV_8UC3},
    // Not as PNG: image_transport's plugin drops alpha, but PNG must not lose anything.
    {"bgra8", CV_8UC4, "bgr8", nullptr, cv::COLOR_BGRA2BGR, cv::COLOR_BGR2BGRA, CV_8UC3},
    {"rgba8", CV_8UC4, "bgr8", nullptr, cv::COLOR_RGBA2BGR, cv::COLOR_BGR2RGBA, CV_8UC3},
    {"mono16", CV_16UC1, nullptr, "mono16", NONE, NONE, CV_16UC1},
    {"16UC1", CV_16UC1, nullptr, "mono16", NONE, NONE, CV_16UC1},
    {"bgr16", CV_16UC3, nullptr, "bgr16", NONE, NONE, CV_16UC3},
    {"16UC3", CV_16UC3, nullptr, "bgr16", NONE, NONE, CV_16UC3},
    {"rgb16", CV_16UC3, nullptr, "bgr16", cv::COLOR_RGB2BGR, cv::COLOR_BGR2RGB, CV_16UC3},
};

const PixelFormat* findFormat(const std::string& encoding)
{
  for (const PixelFormat& format : FORMATS)
  {
    if (encoding == format.encoding)
    {
      return &format;
    }
  }
  return nullptr;
}

/// Skips `fixed` bytes, then an array of bytes with its length in front.
/// @throws BadData if the message is shorter: roscpp would first allocate the claimed length, up to 4 GiB.
void skipArray(PayloadReader* in, size_t fixed)
{
  in->skip(fixed);
  in->skip(in->getU32());
  if (!in->ok())
  {
    throw BadData("the message is cut off");
  }
}

constexpr size_t HEADER_BYTES = 12;  // seq and stamp, before frame_id
void checkArrays(const std::vector<uint8_t>& data, const sensor_msgs::Image*)
{
  PayloadReader in(data.data(), data.size());
  skipArray(&in, HEADER_BYTES);  // frame_id
  skipArray(&in, 8);             // encoding, behind height and width
  skipArray(&in, 5);             // data, behind is_bigendian and step
}
void checkArrays(const std::vector<uint8_t>& data, const sensor_msgs::CompressedImage*)
{
  PayloadReader in(data.data(), data.size());
  skipArray(&in, HEADER_BYTES);  // frame_id
  skipArray(&in, 0);             // format
  skipArray(&in, 0);             // data
}

template <typename Message>
Message deserialize(std::vector<uint8_t>* data)
{
  checkArrays(*data, static_cast<const Message*>(nullptr));
  Message message;
  try
  {
    ros::serialization::IStream stream(data->data(), static_cast<uint32_t>(data->size()));
    ros::serialization::deserialize(stream, message);
    if (stream.getLength() != 0)
    {
      throw BadData("bytes follow the message");
    }
  }
  catch (const ros::serialization::StreamOverrunException&)
  {
    throw BadData("the message is cut off");
  }
  return message;
}

template <typename Message>
std::vector<uint8_t> serialize(const Message& message)
{
  std::vector<uint8_t> data(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(data.data(), static_cast<uint32_t>(data.size()));
  ros::serialization::serialize(stream, message);
  return data;
}

std::vector<uint8_t> encode(std::vector<uint8_t>* data, bool jpeg, int quality)
{
  auto image = deserialize<sensor_msgs::Image>(data);
  const PixelFormat* format = findFormat(image.encoding);
  const char* compressed_as = format == nullptr ? nullptr : jpeg ? format->jpeg : format->png;
  if (compressed_as == nullptr)
  {
    throw Unsupported("encoding \"" + image.encoding + "\" has no " + (jpeg ? "jpeg" : "png") + " form");
  }
  const size_t pixel = CV_ELEM_SIZE(format->type);
  if (image.width == 0 || image.height == 0 || image.width > INT32_MAX || image.height > INT32_MAX ||
      image.step < image.width * pixel || image.data.size() / image.step < image.height)
  {
    throw Unsupported("an image of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                      " pixels with a step of " + std::to_string(image.step) + " and " +
                      std::to_string(image.data.size()) + " bytes");
  }
  if (CV_ELEM_SIZE1(format->type) > 1 && (image.is_bigendian != 0) != HOST_IS_BIG_ENDIAN)
  {
    throw Unsupported("pixels in the other byte order");
  }
  cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), format->type, image.data.data(),
                 image.step);
  if (format->to_compressed != NONE)
  {
    cv::Mat converted;
    cv::cvtColor(pixels, converted, format->to_compressed);
    pixels = converted;
  }
  sensor_msgs::CompressedImage compressed;
  compressed.header = image.header;
  compressed.format = image.encoding + (jpeg ? "; jpeg compressed " : "; png compressed ") + compressed_as;
  try
  {
    if (!cv::imencode(jpeg ? ".jpg" : ".png", pixels, compressed.data,
                      {jpeg ? cv::IMWRITE_JPEG_QUALITY : cv::IMWRITE_PNG_COMPRESSION, quality}))
    {
      throw Unsupported("OpenCV cannot compress it");
    }
  }
  catch (const cv::Exception& exception)
  {
    throw Unsupported(exception.what());  // for example JPEG with more than 65500 pixels per side
  }
  return serialize(compressed);
}

struct Size
{
  uint64_t width = 0;
  uint64_t height = 0;
};

uint64_t bigEndian(const uint8_t* bytes, size_t count)
{
  uint64_t value = 0;
  for (size_t index = 0; index < count; ++index)
  {
    value = value << 8 | bytes[index];
  }
  return value;
}

bool isPng(const std::vector<uint8_t>& data)
{
  static constexpr uint8_t SIGNATURE[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  return data.size() >= sizeof(SIGNATURE) && std::memcmp(data.data(), SIGNATURE, sizeof(SIGNATURE)) == 0;
}

/// Size that the header of a PNG or JPEG announces. Data of any other format never reach OpenCV, whose many decoders
/// are of unequal quality.
std::optional<Size> announcedSize(const std::vector<uint8_t>& data)
{
  if (isPng(data))
  {
    if (data.size() < 24 || std::memcmp(&data[12], "IHDR", 4) != 0)
    {
      return std::nullopt;
    }
    return Size{bigEndian(&data[16], 4), bigEndian(&data[20], 4)};
  }
  if (data.size() < 4 || data[0] != 0xff || data[1] != 0xd8)
  {
    return std::nullopt;
  }
  for (size_t at = 2; at + 4 <= data.size();)
  {
    if (data[at] != 0xff)
    {
      return std::nullopt;
    }
    const uint8_t marker = data[at + 1];
    if (marker == 0xff)
    {
      ++at;  // padding
      continue;
    }
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame && at + 9 <= data.size())
    {
      return Size{bigEndian(&data[at + 7], 2), bigEndian(&data[at + 5], 2)};
    }
    if (frame || marker == 0x01 || marker == 0xd9 || marker == 0xda || (marker >= 0xd0 && marker <= 0xd8))
    {
      return std::nullopt;  // truncated, or a scan without a frame
    }
    at += 2 + bigEndian(&data[at + 2], 2);
  }
  return std::nullopt;
}

/// Decompresses the pixels of an image whose size is known.
cv::Mat decodePixels(const sensor_msgs::CompressedImage& compressed, const PixelFormat& format, const Size& size)
{
  try
  {
    // Unchanged also ignores the rotation in EXIF data.
    cv::Mat pixels = cv::imdecode(compressed.data, cv::IMREAD_UNCHANGED);
    if (pixels.empty() || pixels.type() != format.compressed_type || static_cast<uint64_t>(pixels.cols) != size.width ||
        static_cast<uint64_t>(pixels.rows) != size.height)
    {
      throw BadData("the data do not hold what format \"" + compressed.format + "\" announces");
    }
    if (format.from_compressed != NONE)
    {
      cv::Mat converted;
      cv::cvtColor(pixels, converted, format.from_compressed);
      pixels = converted;
    }
    return pixels.isContinuous() ? pixels : pixels.clone();
  }
  catch (const cv::Exception& exception)
  {
    throw BadData(exception.what());
  }
}

std::vector<uint8_t> decode(std::vector<uint8_t>* data, uint64_t max_bytes)
{
  const auto compressed = deserialize<sensor_msgs::CompressedImage>(data);
  const size_t end = compressed.format.find(';');
  const std::string encoding = compressed.format.substr(0, end);
  const PixelFormat* format = findFormat(encoding);
  if (end == std::string::npos || format == nullptr)
  {
    throw BadData("format \"" + compressed.format + "\" is none of ours");
  }
  const std::optional<Size> size = announcedSize(compressed.data);
  if (!size || size->width == 0 || size->height == 0)
  {
    throw BadData("the data are neither JPEG nor PNG");
  }
  const uint64_t pixel = CV_ELEM_SIZE(format->type);
  // Divided, because a product of 32-bit sizes could overflow.
  if (size->width > max_bytes / pixel / size->height)
  {
    throw BadData("an image of " + std::to_string(size->width) + " x " + std::to_string(size->height) +
                  " pixels is larger than " + std::to_string(max_bytes) + " bytes");
  }
  const cv::Mat pixels = decodePixels(compressed, *format, *size);
  sensor_msgs::Image image;
  image.header = compressed.header;
  image.encoding = encoding;
  image.width = static_cast<uint32_t>(pixels.cols);
  image.height = static_cast<uint32_t>(pixels.rows);
  image.is_bigendian = HOST_IS_BIG_ENDIAN ? 1 : 0;
  image.step = static_cast<uint32_t>(image.width * pixel);
  image.data.assign(pixels.data, pixels.data + size_t{image.step} * image.height);
  std::vector<uint8_t> serialized = serialize(image);
  if (serialized.size() > max_bytes)
  {
    throw BadData("an image of " + std::to_string(serialized.size()) + " bytes is larger than " +
                  std::to_string(max_bytes));
  }
  return serialized;
}

}  // namespace

CodecHeader convertImage(const CodecHeader& request, std::vector<uint8_t>* data, uint64_t max_bytes)
{
  CodecHeader header;
  header.id = request.id;
  std::string text;
  try
  {
    *data = request.kind == CodecHeader::DECODE
                ? decode(data, max_bytes)
                : encode(data, request.kind == CodecHeader::ENCODE_JPEG, static_cast<int>(request.parameter));
    header.kind = CodecHeader::CONVERTED;
    if (data->size() > max_bytes)
    {
      throw Unsupported("compressed it is larger than " + std::to_string(max_bytes) + " bytes");
    }
  }
  catch (const Unsupported& exception)
  {
    header.kind = CodecHeader::UNSUPPORTED;
    text = exception.what();
  }
  catch (const std::exception& exception)  // BadData, or out of memory
  {
    header.kind = CodecHeader::BAD_DATA;
    text = exception.what();
  }
  if (header.kind != CodecHeader::CONVERTED)
  {
    text.resize(std::min<size_t>(text.size(), MAX_CODEC_TEXT));
    data->assign(text.begin(), text.end());
  }
  header.length = data->size();
  return header;
}

}  // namespace pi_os_transport
