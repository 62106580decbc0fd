#pragma once

// sensor_msgs/PointCloud2 as points of a PCL type without a copy. Needs PCL's common headers. A pcl::PointCloud cannot
// share its points, because it owns a std::vector; therefore an array of points is shared.

#include <pcl/conversions.h>
#include <pcl/point_cloud.h>
#include <pcl/type_traits.h>
#include <sensor_msgs/PointCloud2.h>

#include <boost/shared_ptr.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "pi_os_transport/zero_copy/message.h"

namespace pi_os_transport::zero_copy
{

/// The points of a received message, read-only, row by row. Keeps the message.
template <typename Point>
class SharedPoints
{
public:
  SharedPoints(const Point* points, uint32_t width, uint32_t height, boost::shared_ptr<const void> keeper)
    : points_(points), width_(width), height_(height), keeper_(std::move(keeper))
  {
  }

  uint32_t width() const { return width_; }
  uint32_t height() const { return height_; }
  size_t size() const { return size_t{width_} * height_; }
  const Point* begin() const { return points_; }
  const Point* end() const { return points_ + size(); }
  const Point& operator[](size_t index) const { return points_[index]; }

private:
  const Point* points_;
  uint32_t width_;
  uint32_t height_;
  boost::shared_ptr<const void> keeper_;
};

namespace detail
{

template <typename A>
std::vector<pcl::PCLPointField> toPclFields(const sensor_msgs::PointCloud2_<A>& cloud)
{
  std::vector<pcl::PCLPointField> fields;
  for (const auto& from : cloud.fields)
  {
    pcl::PCLPointField field;
    field.name = from.name;
    field.offset = from.offset;
    field.datatype = from.datatype;
    field.count = from.count;
    fields.push_back(std::move(field));
  }
  return fields;
}

/// True if every field of Point has the same offset in the message.
template <typename Point, typename A>
bool hasLayoutOf(const sensor_msgs::PointCloud2_<A>& cloud)
{
  if (cloud.point_step != sizeof(Point))
  {
    return false;
  }
  const std::vector<pcl::PCLPointField> theirs = toPclFields(cloud);
  std::vector<pcl::PCLPointField> ours;
  pcl::for_each_type<typename pcl::traits::fieldList<Point>::type>(pcl::detail::FieldAdder<Point>(ours));
  return std::all_of(ours.begin(), ours.end(),
                     [&theirs](const pcl::PCLPointField& field)
                     {
                       return std::any_of(theirs.begin(), theirs.end(),
                                          [&field](const pcl::PCLPointField& other)
                                          {
                                            return other.name == field.name && other.offset == field.offset &&
                                                   other.datatype == field.datatype && other.count == field.count;
                                          });
                     });
}

template <typename A>
uint64_t bytesOfRow(const sensor_msgs::PointCloud2_<A>& cloud)
{
  return uint64_t{cloud.point_step} * cloud.width;
}

/// @throws std::runtime_error if the message lacks data.
template <typename A>
void checkCloud(const sensor_msgs::PointCloud2_<A>& cloud)
{
  if (cloud.row_step < bytesOfRow(cloud) || uint64_t{cloud.row_step} * cloud.height > cloud.data.size())
  {
    throw std::runtime_error("cloud of " + std::to_string(cloud.width) + "x" + std::to_string(cloud.height) +
                             " points has point_step = " + std::to_string(cloud.point_step) + ", row_step = " +
                             std::to_string(cloud.row_step) + " and " + std::to_string(cloud.data.size()) +
                             " bytes of data, must have row_step of at least point_step times width, and row_step "
                             "times height bytes");
  }
}

}  // namespace detail

/// Shares the points of a message. @return nothing if their layout or alignment differs from Point: then use
/// copyPoints(). Always works for messages made by resizePoints() with the same Point.
/// @throws std::runtime_error if the message lacks data.
template <typename Point, typename A>
std::optional<SharedPoints<Point>> sharePoints(const boost::shared_ptr<sensor_msgs::PointCloud2_<A> const>& cloud)
{
  detail::checkCloud(*cloud);
  const auto* const data = cloud->data.data();
  if (!detail::hasLayoutOf<Point>(*cloud) || (cloud->height > 1 && cloud->row_step != detail::bytesOfRow(*cloud)) ||
      reinterpret_cast<uintptr_t>(data) % alignof(Point) != 0)
  {
    return std::nullopt;
  }
  return SharedPoints<Point>(reinterpret_cast<const Point*>(data), cloud->width, cloud->height, cloud);
}

/// Copies the points of any message that has all fields of Point.
/// @throws std::runtime_error if the message lacks data, or points do not have the size that their fields need.
template <typename Point, typename A>
pcl::PointCloud<Point> copyPoints(const sensor_msgs::PointCloud2_<A>& from)
{
  // PCL does not check the sizes in a message.
  detail::checkCloud(from);
  pcl::PCLPointCloud2 whole;
  whole.header.seq = from.header.seq;
  whole.header.stamp = from.header.stamp.toNSec() / 1000;
  whole.header.frame_id = from.header.frame_id;
  whole.height = from.height;
  whole.width = from.width;
  whole.fields = detail::toPclFields(from);
  whole.is_bigendian = from.is_bigendian;
  whole.point_step = from.point_step;
  whole.row_step = from.row_step;
  // Without the bytes behind the last row, which PCL would copy.
  const uint64_t bytes = uint64_t{from.row_step} * from.height;
  whole.data.assign(from.data.begin(), from.data.begin() + static_cast<std::ptrdiff_t>(bytes));
  whole.is_dense = from.is_dense;
  pcl::PointCloud<Point> cloud;
  if (from.width == 0 || from.height == 0)
  {
    cloud.header = whole.header;
    return cloud;
  }
  if (from.point_step == 0)
  {
    throw std::runtime_error("cloud of " + std::to_string(from.width) + "x" + std::to_string(from.height) +
                             " points has point_step = 0");
  }
  pcl::MsgFieldMap fields;
  pcl::createMapping<Point>(whole.fields, fields);
  for (const auto& field : fields)
  {
    if (field.size > from.point_step || field.serialized_offset > from.point_step - field.size ||
        field.struct_offset + field.size > sizeof(Point))
    {
      throw std::runtime_error("cloud with point_step = " + std::to_string(from.point_step) + " has " +
                               std::to_string(field.size) + " bytes of fields at offset " +
                               std::to_string(field.serialized_offset));
    }
  }
  pcl::fromPCLPointCloud2(whole, cloud, fields);
  return cloud;
}

/// Sets the size and the fields of a message for Point, and returns its points for writing, row by row. They are valid
/// until the data is resized or published, and not initialised. Sets all fields except header and is_dense.
template <typename Point, typename A>
Point* resizePoints(sensor_msgs::PointCloud2_<A>* cloud, uint32_t width, uint32_t height)
{
  std::vector<pcl::PCLPointField> fields;
  pcl::for_each_type<typename pcl::traits::fieldList<Point>::type>(pcl::detail::FieldAdder<Point>(fields));
  cloud->fields.resize(fields.size());
  for (size_t i = 0; i < fields.size(); ++i)
  {
    cloud->fields[i].name = fields[i].name;
    cloud->fields[i].offset = fields[i].offset;
    cloud->fields[i].datatype = fields[i].datatype;
    cloud->fields[i].count = fields[i].count;
  }
  cloud->width = width;
  cloud->height = height;
  cloud->is_bigendian = 0;
  cloud->point_step = sizeof(Point);
  cloud->row_step = static_cast<uint32_t>(sizeof(Point)) * width;
  cloud->data.resize(size_t{cloud->row_step} * height);
  return reinterpret_cast<Point*>(cloud->data.data());
}

}  // namespace pi_os_transport::zero_copy
