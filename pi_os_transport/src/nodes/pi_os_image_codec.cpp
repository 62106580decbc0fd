// pi_os_image_codec: compresses images for pi_os_bridge and restores them (protocol: bridge/image_codec.h). The bridge
// starts it and may end it at any time; what it is given to decode may be hostile.
//
// usage: pi_os_image_codec MAX_BYTES, with the socket as descriptor 3

#include <fcntl.h>
#include <ros/serialization.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "image_codec/image_codec.h"
#include "wire/payload.h"

namespace pi_os_transport
{
namespace
{

/// An image that a compression cannot carry, or data that are none; the text says why.
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
  const char* jpeg;     ///< what the format string names as compressed; null: JPEG cannot carry it
  const char* png;      ///< the same for PNG
  int to_compressed;    ///< conversion before compressing, NONE if there is none
  int from_compressed;  ///< conversion after
  int compressed_type;  ///< of OpenCV, after decoding
};

constexpr int NONE = -1;
constexpr PixelFormat FORMATS[] = {
    {"mono8", CV_8UC1, "mono8", "mono8", NONE, NONE, CV_8UC1},
    {"8UC1", CV_8UC1, "mono8", "mono8", NONE, NONE, CV_8UC1},
    {"bgr8", CV_8UC3, "bgr8", "bgr8", NONE, NONE, CV_8UC3},
    {"8UC3", CV_8UC3, "bgr8", "bgr8", NONE, NONE, CV_8UC3},
    {"rgb8", CV_8UC3, "bgr8", "bgr8", cv::COLOR_RGB2BGR, cv::COLOR_BGR2RGB, CV_8UC3},
    // Without PNG: the plugin drops alpha, which nobody expects of a compression without loss.
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

/// Passes over a field of the message: `fixed` bytes, then an array of bytes with its length in front.
/// @throws BadData if it does not fit: roscpp would take memory for all it claims, up to 4 GiB, before it notices.
void skipArray(PayloadReader* in, size_t fixed)
{
  in->skip(fixed);
  in->skip(in->getU32());
  if (!in->ok())
  {
    throw BadData("the message is cut off");
  }
}

/// The arrays of bytes of a message, each with what stands before it.
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

bool hostIsBigEndian()
{
  const uint16_t one = 1;
  uint8_t first = 0;
  std::memcpy(&first, &one, 1);
  return first == 0;
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
  if (CV_ELEM_SIZE1(format->type) > 1 && (image.is_bigendian != 0) != hostIsBigEndian())
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
    throw Unsupported(exception.what());  // JPEG ends at 65500 pixels per side
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

/// Size that the header of a PNG or JPEG announces. OpenCV looks for many more formats, with decoders of every quality:
/// nothing else reaches it.
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
      return std::nullopt;  // cut off, or the scan begins without a frame
    }
    at += 2 + bigEndian(&data[at + 2], 2);
  }
  return std::nullopt;
}

std::vector<uint8_t> decode(std::vector<uint8_t>* data, uint64_t max_bytes)
{
  auto compressed = deserialize<sensor_msgs::CompressedImage>(data);
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
  // Widths and heights have at most 32 bits: divided, nothing overflows.
  if (size->width > max_bytes / pixel / size->height)
  {
    throw BadData("an image of " + std::to_string(size->width) + " x " + std::to_string(size->height) +
                  " pixels is larger than " + std::to_string(max_bytes) + " bytes");
  }
  cv::Mat pixels;
  try
  {
    // Unchanged also means: not turned as EXIF data tell.
    pixels = cv::imdecode(compressed.data, cv::IMREAD_UNCHANGED);
    if (pixels.empty() || pixels.type() != format->compressed_type ||
        static_cast<uint64_t>(pixels.cols) != size->width || static_cast<uint64_t>(pixels.rows) != size->height)
    {
      throw BadData("the data do not hold what format \"" + compressed.format + "\" announces");
    }
    if (format->from_compressed != NONE)
    {
      cv::Mat converted;
      cv::cvtColor(pixels, converted, format->from_compressed);
      pixels = converted;
    }
  }
  catch (const cv::Exception& exception)
  {
    throw BadData(exception.what());
  }
  sensor_msgs::Image image;
  image.header = compressed.header;
  image.encoding = encoding;
  image.width = static_cast<uint32_t>(pixels.cols);
  image.height = static_cast<uint32_t>(pixels.rows);
  image.is_bigendian = hostIsBigEndian() ? 1 : 0;
  image.step = static_cast<uint32_t>(static_cast<uint64_t>(pixels.cols) * pixel);
  const size_t bytes = size_t{image.step} * image.height;
  if (!pixels.isContinuous())
  {
    pixels = pixels.clone();
  }
  image.data.assign(pixels.data, pixels.data + bytes);
  std::vector<uint8_t> serialized = serialize(image);
  if (serialized.size() > max_bytes)
  {
    throw BadData("an image of " + std::to_string(serialized.size()) + " bytes is larger than " +
                  std::to_string(max_bytes));
  }
  return serialized;
}

// ---------------------------------------------------------------------------------------------------------- the socket

/// False at the end of the stream.
bool receiveAll(uint8_t* data, size_t length)
{
  while (length > 0)
  {
    const ssize_t received = recv(CODEC_SOCKET, data, length, 0);
    if (received < 0 && errno == EINTR)
    {
      continue;
    }
    if (received <= 0)
    {
      return false;
    }
    data += received;
    length -= static_cast<size_t>(received);
  }
  return true;
}

bool sendAll(const uint8_t* data, size_t length)
{
  while (length > 0)
  {
    const ssize_t sent = send(CODEC_SOCKET, data, length, MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR)
    {
      continue;
    }
    if (sent <= 0)
    {
      return false;
    }
    data += sent;
    length -= static_cast<size_t>(sent);
  }
  return true;
}

CodecHeader answer(const CodecHeader& request, std::vector<uint8_t>* data, uint64_t max_bytes)
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
  catch (const std::exception& exception)  // BadData, and memory that does not suffice
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

/// Address space for a few copies of the largest message above what the libraries take; no files, and nothing to say:
/// libpng and libjpeg write a line to stderr for every damaged image.
void confine(uint64_t max_bytes)
{
  const int nowhere = open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
  {
    dup2(nowhere, stream);
  }
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  prctl(PR_SET_DUMPABLE, 0);
  unsigned long pages = 0;
  FILE* statm = std::fopen("/proc/self/statm", "re");
  if (statm != nullptr)
  {
    if (std::fscanf(statm, "%lu", &pages) != 1)
    {
      pages = 0;
    }
    std::fclose(statm);
  }
  if (pages > 0)
  {
    const rlim_t space = pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) + 6 * max_bytes + (64U << 20);
    const rlimit limit{space, space};
    setrlimit(RLIMIT_AS, &limit);
  }
  const rlimit none{0, 0};
  setrlimit(RLIMIT_CORE, &none);
  setrlimit(RLIMIT_FSIZE, &none);
  setrlimit(RLIMIT_NOFILE, &none);
}

int run(uint64_t max_bytes)
{
  for (;;)
  {
    uint8_t bytes[CodecHeader::BYTES];
    if (!receiveAll(bytes, sizeof(bytes)))
    {
      return 0;
    }
    const CodecHeader request = CodecHeader::decode(bytes);
    if (request.kind < CodecHeader::ENCODE_JPEG || request.kind > CodecHeader::DECODE || request.length > max_bytes)
    {
      return 1;
    }
    std::vector<uint8_t> data(request.length);
    if (!receiveAll(data.data(), data.size()))
    {
      return 0;
    }
    const CodecHeader reply = answer(request, &data, max_bytes);
    if (!sendAll(reply.encode().data(), CodecHeader::BYTES) || !sendAll(data.data(), data.size()))
    {
      return 0;
    }
  }
}

}  // namespace
}  // namespace pi_os_transport

int main(int argc, char** argv)
{
  const uint64_t max_bytes = argc == 2 ? std::strtoull(argv[1], nullptr, 10) : 0;
  int type = 0;
  socklen_t length = sizeof(type);
  if (max_bytes == 0 || getsockopt(pi_os_transport::CODEC_SOCKET, SOL_SOCKET, SO_TYPE, &type, &length) != 0)
  {
    std::fputs("pi_os_image_codec: is started by pi_os_bridge, not by hand\n", stderr);
    return 2;
  }
  cv::setNumThreads(1);
  pi_os_transport::confine(max_bytes);
  return pi_os_transport::run(max_bytes);
}
