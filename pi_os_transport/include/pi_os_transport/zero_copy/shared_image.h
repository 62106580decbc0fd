#pragma once

// sensor_msgs/Image as cv::Mat without a copy: over a received message, which the matrix keeps, or over a loan, for
// drawing. Needs OpenCV's core. Works for all forms of the message.

#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include <opencv2/core.hpp>

#include <boost/shared_ptr.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

#include "pi_os_transport/zero_copy/message.h"

namespace pi_os_transport::zero_copy
{

/// OpenCV's type of an encoding: "bgr8" is CV_8UC3, "32FC1" CV_32FC1.
/// @throws std::runtime_error if there is none.
inline int matType(const std::string& encoding)
{
  namespace encodings = sensor_msgs::image_encodings;
  const int channels = encodings::numChannels(encoding);
  const int bits = encodings::bitDepth(encoding);
  if (channels < 1 || channels > CV_CN_MAX)
  {
    throw std::runtime_error("encoding \"" + encoding + "\" has no matrix type: channels must be in [1, " +
                             std::to_string(CV_CN_MAX) + "]");
  }
  const bool is_abstract =
      encoding.find('C') != std::string::npos && encoding.find_first_of("USF") != std::string::npos;
  const char kind = is_abstract ? encoding[encoding.find_first_of("USF")] : 'U';
  switch (bits)
  {
    case 8:
      return CV_MAKETYPE(kind == 'S' ? CV_8S : CV_8U, channels);
    case 16:
      return CV_MAKETYPE(kind == 'S' ? CV_16S : kind == 'F' ? CV_16F : CV_16U, channels);
    case 32:
      return CV_MAKETYPE(kind == 'F' ? CV_32F : CV_32S, channels);
    case 64:
      return CV_MAKETYPE(CV_64F, channels);
    default:
      throw std::runtime_error("encoding \"" + encoding + "\" has no matrix type");
  }
}

namespace detail
{

/// Releases the owner of a matrix's memory with the last copy of the matrix.
class KeeperAllocator : public cv::MatAllocator
{
public:
  static const KeeperAllocator& instance()
  {
    static const KeeperAllocator* allocator = new KeeperAllocator;  // matrices may outlive static objects
    return *allocator;
  }

  cv::UMatData* allocate(int dims, const int* sizes, int type, void* data, size_t* step, cv::AccessFlag flags,
                         cv::UMatUsageFlags usage) const override
  {
    return cv::Mat::getStdAllocator()->allocate(dims, sizes, type, data, step, flags, usage);
  }
  bool allocate(cv::UMatData*, cv::AccessFlag, cv::UMatUsageFlags) const override { return false; }
  void deallocate(cv::UMatData* data) const override
  {
    delete static_cast<boost::shared_ptr<const void>*>(data->userdata);
    delete data;
  }
};

inline cv::Mat keep(cv::Mat matrix, const boost::shared_ptr<const void>& keeper)
{
  auto* const data = new cv::UMatData(&KeeperAllocator::instance());
  data->data = data->origdata = matrix.data;
  data->size = matrix.rows > 0 ? matrix.step[0] * static_cast<size_t>(matrix.rows) : 0;
  data->flags = cv::UMatData::USER_ALLOCATED;
  data->userdata = new boost::shared_ptr<const void>(keeper);
  data->refcount = 1;
  matrix.u = data;
  return matrix;
}

template <typename A>
void checkImage(const sensor_msgs::Image_<A>& image, int type)
{
  constexpr uint32_t MOST = std::numeric_limits<int>::max();
  if (image.width > MOST || image.height > MOST || image.step % CV_ELEM_SIZE1(type) != 0)
  {
    throw std::runtime_error("image of " + std::to_string(image.width) + "x" + std::to_string(image.height) + " \"" +
                             image.encoding + "\" with step = " + std::to_string(image.step) +
                             " is no matrix: sizes must be below 2^31, step a multiple of " +
                             std::to_string(CV_ELEM_SIZE1(type)));
  }
  const size_t row_bytes = static_cast<size_t>(CV_ELEM_SIZE(type)) * image.width;
  if (image.step < row_bytes || uint64_t{image.step} * image.height > image.data.size())
  {
    throw std::runtime_error("image of " + std::to_string(image.width) + "x" + std::to_string(image.height) + " \"" +
                             image.encoding + "\" has step = " + std::to_string(image.step) + " and " +
                             std::to_string(image.data.size()) + " bytes of data, must have at least " +
                             std::to_string(row_bytes) + " and step times height");
  }
}

}  // namespace detail

/// A read-only matrix over the image, which must outlive it. An image without columns gives a matrix without rows, so
/// that loops over its rows end at once.
/// @throws std::runtime_error if the encoding has no matrix type, or the image is inconsistent or lacks data.
template <typename A>
cv::Mat matOver(const sensor_msgs::Image_<A>& image)
{
  const int type = matType(image.encoding);
  detail::checkImage(image, type);
  const int rows = image.width == 0 ? 0 : static_cast<int>(image.height);
  return cv::Mat(rows, static_cast<int>(image.width), type, const_cast<uint8_t*>(image.data.data()), image.step);
}

/// A read-only matrix over a received image. The matrix, its copies and its parts keep the image.
/// @throws like matOver().
template <typename A>
cv::Mat shareMat(const boost::shared_ptr<sensor_msgs::Image_<A> const>& image)
{
  return detail::keep(matOver(*image), image);
}

/// Sets the size of the image and returns a matrix over it for drawing, valid until the data is resized or published.
/// Sets height, width, encoding and step; rows have no gaps. Pixels are not initialised.
/// @throws std::runtime_error if the encoding has no matrix type or the size is invalid.
template <typename A>
cv::Mat resizeImage(sensor_msgs::Image_<A>* image, int rows, int cols, const std::string& encoding)
{
  const int type = matType(encoding);
  if (rows < 0 || cols < 0)
  {
    throw std::runtime_error("image of " + std::to_string(cols) + "x" + std::to_string(rows) +
                             " pixels, neither must be negative");
  }
  image->height = static_cast<uint32_t>(rows);
  image->width = static_cast<uint32_t>(cols);
  image->encoding = encoding;
  image->is_bigendian = 0;
  image->step = static_cast<uint32_t>(static_cast<size_t>(CV_ELEM_SIZE(type)) * image->width);
  image->data.resize(size_t{image->step} * image->height);
  return cv::Mat(rows, cols, type, image->data.data(), image->step);
}

}  // namespace pi_os_transport::zero_copy
