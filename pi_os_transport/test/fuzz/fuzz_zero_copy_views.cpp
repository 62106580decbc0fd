// Messages of peers as zero-copy subscribers read them: large arrays where they lie, images as matrices, clouds as
// points.

#include <geometry_msgs/PoseArray.h>
#include <nav_msgs/OccupancyGrid.h>
#include <pcl/console/print.h>
#include <pcl/point_types.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/MultiEchoLaserScan.h>
#include <sensor_msgs/PointCloud2.h>

#include <boost/make_shared.hpp>

#include <exception>
#include <memory>
#include <new>
#include <stdexcept>

#include "fuzz_input.h"
#include "pi_os_transport/zero_copy/cv_bridge.h"
#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/point_cloud.h"
#include "pi_os_transport/zero_copy/shared_image.h"
#include "pi_os_transport/zero_copy/statistics.h"
#include "pi_os_transport/zero_copy/subscriber.h"
#include "preload/zero_copy_api.h"

namespace pi_os_transport::zero_copy
{
namespace
{

uint64_t held = 0;

/// In the place of the preloaded library: every message can be held.
const PiOsZeroCopyApi API{PI_OS_ZERO_COPY_VERSION,
                          [](size_t, size_t*) -> uint8_t* { return nullptr; },
                          [](uint8_t*, uint8_t*) {},
                          [](const uint8_t*) {},
                          [] {},
                          [](const uint8_t* message) -> void*
                          {
                            ++held;
                            return const_cast<uint8_t*>(message);
                          },
                          [](void*) { --held; }};

template <typename M>
std::vector<uint8_t> bytesOf(const M& message)
{
  std::vector<uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

/// @return null if the bytes are no message.
template <typename M>
ConstPtr<M> receiveAs(uint8_t* bytes, uint32_t length)
{
  static const std::shared_ptr<TopicCounters> counters = countersOf("/fuzz", false);
  boost::shared_ptr<Message<M>> message;
  try
  {
    message = receive<Message<M>>(bytes, length, counters.get());
  }
  catch (const ros::serialization::StreamOverrunException&)
  {
    return nullptr;
  }
  const std::vector<uint8_t> written = bytesOf(*message);
  require(written.size() <= length, "a message is no longer than its bytes");
  M standard;
  ros::serialization::IStream stream(bytes, length);
  ros::serialization::deserialize(stream, standard);
  require(bytesOf(standard) == written, "both forms of a message have the same content");
  const Message<M> copy = *message;
  require(bytesOf(copy) == written, "a copy has the same content");
  return message;
}

void useImage(const ConstPtr<sensor_msgs::Image>& image, bool as_gray)
{
  cv::Mat matrix;
  try
  {
    matrix = shareMat(image);
  }
  catch (const std::runtime_error&)
  {
    return;
  }
  for (int row = 0; row < matrix.rows; ++row)
  {
    sumOf(matrix.ptr(row), matrix.elemSize() * static_cast<size_t>(matrix.cols));
  }
  try
  {
    toCvShare(image, as_gray ? "mono8" : "");
  }
  catch (const std::exception&)  // OpenCV has reasons of its own not to convert
  {
  }
}

template <typename Point>
void useCloud(const ConstPtr<sensor_msgs::PointCloud2>& cloud)
{
  try
  {
    if (const auto points = sharePoints<Point>(cloud))
    {
      sumOf(reinterpret_cast<const uint8_t*>(points->begin()), points->size() * sizeof(Point));
    }
    const pcl::PointCloud<Point> copy = copyPoints<Point>(*cloud);
    require(copy.size() <= cloud->data.size(), "no more points than bytes");
  }
  catch (const std::runtime_error&)
  {
  }
}

void fuzz(FuzzInput input)
{
  static const bool quiet = (pcl::console::setVerbosityLevel(pcl::console::L_ERROR), true);
  static_cast<void>(quiet);
  const uint32_t kind = input.below(6);
  const size_t shift = input.below(4) == 0 ? input.below(8) : 0;
  const uint32_t padding = input.below(2) == 0 ? 0 : 1500;  // arrays from 1024 bytes on become views
  const bool option = input.below(2) == 1;
  const std::vector<uint8_t> bytes = input.rest();
  const uint32_t length = static_cast<uint32_t>(bytes.size()) + padding;
  // Of exactly this size: the address sanitizer sees what is read beyond it.
  const auto memory = std::make_unique<uint8_t[]>(shift + length);
  std::copy(bytes.begin(), bytes.end(), memory.get() + shift);
  uint8_t* const message = memory.get() + shift;
  switch (kind)
  {
    case 0:
      if (const auto image = receiveAs<sensor_msgs::Image>(message, length))
      {
        useImage(image, option);
      }
      break;
    case 1:
      if (const auto cloud = receiveAs<sensor_msgs::PointCloud2>(message, length))
      {
        useCloud<pcl::PointXYZ>(cloud);
        useCloud<pcl::PointXYZRGB>(cloud);
      }
      break;
    case 2:
      receiveAs<sensor_msgs::CompressedImage>(message, length);
      break;
    case 3:
      receiveAs<geometry_msgs::PoseArray>(message, length);
      break;
    case 4:
      receiveAs<nav_msgs::OccupancyGrid>(message, length);
      break;
    default:
      receiveAs<sensor_msgs::MultiEchoLaserScan>(message, length);
      break;
  }
  require(held == 0, "every message is let go");
}

}  // namespace
}  // namespace pi_os_transport::zero_copy

extern "C" __attribute__((visibility("default"))) const PiOsZeroCopyApi* pi_os_transport_zero_copy(uint32_t)
{
  return &pi_os_transport::zero_copy::API;
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::zero_copy::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
