#pragma once

// cv_bridge for zero-copy images. Link cv_bridge.

#include <cv_bridge/cv_bridge.h>

#include <boost/make_shared.hpp>
#include <boost/shared_ptr.hpp>

#include <string>

#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/shared_image.h"

namespace pi_os_transport::zero_copy
{

/// Like cv_bridge::toCvCopy().
/// @throws cv_bridge::Exception if the conversion is impossible, std::runtime_error as matOver().
template <typename A>
cv_bridge::CvImagePtr toCvCopy(const sensor_msgs::Image_<A>& source, const std::string& encoding = std::string())
{
  std_msgs::Header header;
  copyHeader(source.header, &header);
  const cv::Mat shared = matOver(source);
  if (source.is_bigendian != 0 && shared.elemSize1() > 1)  // cv_bridge converts it to this machine's byte order
  {
    sensor_msgs::Image copy;
    copy.header = header;
    copy.height = source.height;
    copy.width = source.width;
    copy.encoding = source.encoding;
    copy.is_bigendian = source.is_bigendian;
    copy.step = source.step;
    copy.data.assign(source.data.begin(), source.data.end());
    return cv_bridge::toCvCopy(copy, encoding);
  }
  const auto image = boost::make_shared<cv_bridge::CvImage>(header, source.encoding, shared);
  return cv_bridge::cvtColor(image, encoding.empty() ? source.encoding : encoding);
}

/// Like cv_bridge::toCvShare(): shares the data of the message, which lives as long as the result or a copy of its
/// image. Copies if `encoding` differs or the data have the other byte order.
/// @throws cv_bridge::Exception if the conversion is impossible, std::runtime_error as matOver().
template <typename A>
cv_bridge::CvImageConstPtr toCvShare(const boost::shared_ptr<sensor_msgs::Image_<A> const>& source,
                                     const std::string& encoding = std::string())
{
  const cv::Mat shared = shareMat(source);
  const bool turned = source->is_bigendian != 0 && shared.elemSize1() > 1;
  if (turned || (!encoding.empty() && encoding != source->encoding))
  {
    return toCvCopy(*source, encoding);
  }
  std_msgs::Header header;
  copyHeader(source->header, &header);
  return boost::make_shared<cv_bridge::CvImage>(header, source->encoding, shared);
}

}  // namespace pi_os_transport::zero_copy
