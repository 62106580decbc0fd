// Images of peers: serialised messages, and what OpenCV's decoders make of their content.

#include <ros/serialization.h>
#include <sensor_msgs/CompressedImage.h>

#include <opencv2/core.hpp>

#include "fuzz_input.h"
#include "image_codec/image_conversion.h"

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using namespace pi_os_transport;  // NOLINT
  constexpr uint64_t MAX_BYTES = 1 << 20;
  static const bool one_thread = (cv::setNumThreads(1), true);  // as the worker does it
  static_cast<void>(one_thread);
  FuzzInput input(data, size);
  CodecHeader request;
  request.kind = CodecHeader::ENCODE_JPEG + input.below(3);
  request.parameter = 1 + input.below(9);
  if (request.kind == CodecHeader::DECODE && input.below(2) == 0)
  {
    sensor_msgs::CompressedImage image;
    image.format = input.below(2) == 0 ? "bgr8; jpeg compressed bgr8" : "mono16; png compressed mono16";
    image.data = input.rest();
    std::vector<uint8_t> message(ros::serialization::serializationLength(image));
    ros::serialization::OStream stream(message.data(), static_cast<uint32_t>(message.size()));
    ros::serialization::serialize(stream, image);
    convertImage(request, &message, MAX_BYTES);
    return 0;
  }
  std::vector<uint8_t> message = input.rest();
  require(convertImage(request, &message, MAX_BYTES).length == message.size(), "an answer is as long as it says");
  return 0;
}
