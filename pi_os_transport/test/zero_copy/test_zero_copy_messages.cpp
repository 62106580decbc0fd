// Layout and bytes of zero-copy messages, without a master: what Loan::serialise() makes must equal what
// ros::serialization makes of the standard message, field by field the same values must come back, and large arrays
// must not have moved.

#include <geometry_msgs/PoseArray.h>
#include <geometry_msgs/Twist.h>
#include <gtest/gtest.h>
#include <nav_msgs/OccupancyGrid.h>
#include <nav_msgs/Path.h>
#include <ros/serialization.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/MultiEchoLaserScan.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Empty.h>
#include <std_msgs/Float32MultiArray.h>
#include <std_msgs/Int8MultiArray.h>
#include <std_msgs/String.h>
#include <std_msgs/UInt64MultiArray.h>
#include <stereo_msgs/DisparityImage.h>

#include <algorithm>
#include <cstring>
#include <numeric>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "pi_os_transport/zero_copy/loan.h"
#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/serialization.h"
#include "pi_os_transport/zero_copy/statistics.h"
#include "pi_os_transport/zero_copy/subscriber.h"

namespace pi_os_transport::zero_copy
{
namespace
{

// ---------------------------------------------------------------------------------------- random content of any
// message

/// Fills every field of a message that it is told of; the same numbers for both forms of a message.
class Filler
{
public:
  Filler(uint32_t seed, size_t large) : random_(seed), large_(large) {}

  template <typename T>
  std::enable_if_t<std::is_arithmetic_v<T>> fill(T* value)
  {
    *value = static_cast<T>(random_() % 251);
  }
  void fill(std::string* text) { *text = std::string(random_() % 40, static_cast<char>('a' + random_() % 26)); }
  void fill(ros::Time* time) { *time = ros::Time(random_(), random_() % 1000000000); }
  void fill(ros::Duration* duration) { *duration = ros::Duration(static_cast<int32_t>(random_() % 1000), 7); }
  template <typename T, typename Alloc>
  void fill(std::vector<T, Alloc>* array)
  {
    array->resize(std::is_arithmetic_v<T> ? large_ : 3 + random_() % 3);
    for (T& element : *array)
    {
      fill(&element);
    }
  }
  template <typename T, size_t N>
  void fill(boost::array<T, N>* array)
  {
    for (T& element : *array)
    {
      fill(&element);
    }
  }
  template <typename A>
  void fill(std_msgs::Header_<A>* header)
  {
    fill(&header->seq);
    fill(&header->stamp);
    fill(&header->frame_id);
  }
  template <typename A>
  void fill(sensor_msgs::Image_<A>* image)
  {
    fill(&image->header);
    fill(&image->height);
    fill(&image->width);
    fill(&image->encoding);
    fill(&image->is_bigendian);
    fill(&image->step);
    fill(&image->data);
  }
  template <typename A>
  void fill(sensor_msgs::CompressedImage_<A>* image)
  {
    fill(&image->header);
    fill(&image->format);
    fill(&image->data);
  }
  template <typename A>
  void fill(sensor_msgs::PointField_<A>* field)
  {
    fill(&field->name);
    fill(&field->offset);
    fill(&field->datatype);
    fill(&field->count);
  }
  template <typename A>
  void fill(sensor_msgs::PointCloud2_<A>* cloud)
  {
    fill(&cloud->header);
    fill(&cloud->height);
    fill(&cloud->fields);
    fill(&cloud->row_step);
    fill(&cloud->data);
    fill(&cloud->is_dense);
  }
  template <typename A>
  void fill(geometry_msgs::Point32_<A>* point)
  {
    fill(&point->x);
    fill(&point->y);
    fill(&point->z);
  }
  template <typename A>
  void fill(sensor_msgs::ChannelFloat32_<A>* channel)
  {
    fill(&channel->name);
    fill(&channel->values);
  }
  template <typename A>
  void fill(sensor_msgs::PointCloud_<A>* cloud)
  {
    fill(&cloud->header);
    cloud->points.resize(large_);
    for (auto& point : cloud->points)
    {
      fill(&point);
    }
    fill(&cloud->channels);
  }
  template <typename A>
  void fill(sensor_msgs::LaserScan_<A>* scan)
  {
    fill(&scan->header);
    fill(&scan->angle_min);
    fill(&scan->range_max);
    fill(&scan->ranges);
    fill(&scan->intensities);
    scan->intensities.resize(5);
  }
  template <typename A>
  void fill(sensor_msgs::LaserEcho_<A>* echo)
  {
    fill(&echo->echoes);
  }
  template <typename A>
  void fill(sensor_msgs::MultiEchoLaserScan_<A>* scan)
  {
    fill(&scan->header);
    fill(&scan->ranges);
    fill(&scan->intensities);
  }
  template <typename A>
  void fill(geometry_msgs::Pose_<A>* pose)
  {
    fill(&pose->position.x);
    fill(&pose->position.y);
    fill(&pose->position.z);
    fill(&pose->orientation.x);
    fill(&pose->orientation.y);
    fill(&pose->orientation.z);
    fill(&pose->orientation.w);
  }
  template <typename A>
  void fill(geometry_msgs::PoseArray_<A>* poses)
  {
    fill(&poses->header);
    poses->poses.resize(large_);
    for (auto& pose : poses->poses)
    {
      fill(&pose);
    }
  }
  template <typename A>
  void fill(nav_msgs::Path_<A>* path)
  {
    fill(&path->header);
    path->poses.resize(20);
    for (auto& stamped : path->poses)
    {
      fill(&stamped.header);
      fill(&stamped.pose);
    }
  }
  template <typename A>
  void fill(nav_msgs::OccupancyGrid_<A>* grid)
  {
    fill(&grid->header);
    fill(&grid->info.map_load_time);
    fill(&grid->info.resolution);
    fill(&grid->info.width);
    fill(&grid->info.origin);
    fill(&grid->data);
  }
  template <typename A>
  void fill(stereo_msgs::DisparityImage_<A>* disparity)
  {
    fill(&disparity->header);
    fill(&disparity->image);
    fill(&disparity->f);
    fill(&disparity->valid_window.width);
    fill(&disparity->delta_d);
  }
  template <typename A>
  void fill(sensor_msgs::CameraInfo_<A>* info)
  {
    fill(&info->header);
    fill(&info->distortion_model);
    fill(&info->D);
    fill(&info->K);
    fill(&info->P);
    fill(&info->roi.width);
  }
  template <typename A>
  void fill(sensor_msgs::Imu_<A>* imu)
  {
    fill(&imu->header);
    fill(&imu->orientation_covariance);
    fill(&imu->angular_velocity.x);
  }
  template <typename A>
  void fill(std_msgs::String_<A>* text)
  {
    text->data = std::string(large_, 'x');
  }
  template <typename A>
  void fill(std_msgs::Empty_<A>*)
  {
  }
  template <typename A>
  void fill(std_msgs::MultiArrayDimension_<A>* dimension)
  {
    fill(&dimension->label);
    fill(&dimension->size);
    fill(&dimension->stride);
  }
  template <template <typename> class Array, typename A>
  auto fill(Array<A>* array) -> decltype(array->layout.dim, array->data, void())
  {
    fill(&array->layout.dim);
    fill(&array->layout.data_offset);
    fill(&array->data);
  }

private:
  std::minstd_rand random_;
  const size_t large_;
};

std::vector<uint8_t> bytesOf(const ros::SerializedMessage& message)
{
  return std::vector<uint8_t>(message.buf.get(), message.buf.get() + message.num_bytes);
}

template <typename M>
std::vector<uint8_t> standardBytes(const M& message)
{
  return bytesOf(ros::serialization::serializeMessage(message));
}

// -------------------------------------------------------------------------------------------- every type, every size

template <typename M>
class ZeroCopyMessage : public ::testing::Test
{
};

using MessageTypes =
    ::testing::Types<sensor_msgs::Image, sensor_msgs::CompressedImage, sensor_msgs::PointCloud2,
                     sensor_msgs::PointCloud, sensor_msgs::LaserScan, sensor_msgs::MultiEchoLaserScan,
                     geometry_msgs::PoseArray, nav_msgs::Path, nav_msgs::OccupancyGrid, stereo_msgs::DisparityImage,
                     sensor_msgs::CameraInfo, sensor_msgs::Imu, std_msgs::String, std_msgs::Empty,
                     std_msgs::Float32MultiArray, std_msgs::Int8MultiArray, std_msgs::UInt64MultiArray>;
TYPED_TEST_SUITE(ZeroCopyMessage, MessageTypes);

constexpr size_t SIZES[] = {0, 1, 7, 127, 128, 129, 1023, 1024, 1025, 40000};

TYPED_TEST(ZeroCopyMessage, HasTypeAndChecksumOfTheStandardOne)
{
  using Form = Message<TypeParam>;
  EXPECT_STREQ(ros::message_traits::datatype<TypeParam>(), ros::message_traits::datatype<Form>());
  EXPECT_STREQ(ros::message_traits::md5sum<TypeParam>(), ros::message_traits::md5sum<Form>());
  EXPECT_STREQ(ros::message_traits::definition<TypeParam>(), ros::message_traits::definition<Form>());
  EXPECT_EQ(ros::message_traits::hasHeader<TypeParam>(), ros::message_traits::hasHeader<Form>());
}

TYPED_TEST(ZeroCopyMessage, ALoanHasTheBytesOfTheStandardMessage)
{
  for (const size_t large : SIZES)
  {
    TypeParam standard;
    Filler(7, large).fill(&standard);
    auto loan = Loan<TypeParam>::borrow();
    Filler(7, large).fill(loan.get());
    TopicCounters counters("test", true);
    EXPECT_EQ(standardBytes(standard), bytesOf(loan.serialise(&counters))) << large;
    EXPECT_EQ(standardBytes(standard), bytesOf(ros::serialization::serializeMessage(*loan))) << large;
  }
}

TYPED_TEST(ZeroCopyMessage, ComesBackEqualAsViewsAndAsCopies)
{
  using Form = Message<TypeParam>;
  for (const size_t large : SIZES)
  {
    TypeParam standard;
    Filler(3, large).fill(&standard);
    const std::vector<uint8_t> expected = standardBytes(standard);
    for (size_t shift = 0; shift < 8; ++shift)
    {
      const size_t length = expected.size() - 4;
      std::vector<uint8_t> memory(length + 64 + shift);
      uint8_t* const message = memory.data() + shift;
      std::copy(expected.begin() + 4, expected.end(), message);
      Form viewed;
      {
        const ViewScope scope(message, length);
        ros::serialization::IStream stream(message, static_cast<uint32_t>(length));
        ros::serialization::deserialize(stream, viewed);
        EXPECT_EQ(0U, stream.getLength());
      }
      EXPECT_EQ(expected, standardBytes(viewed)) << large << " B, shifted by " << shift;
      Form copied;
      ros::serialization::IStream stream(message, static_cast<uint32_t>(length));
      ros::serialization::deserialize(stream, copied);
      const Form copy = viewed;
      std::fill(memory.begin(), memory.end(), uint8_t{0xee});
      EXPECT_EQ(expected, standardBytes(copied)) << "copies depend on the memory";
      EXPECT_EQ(expected, standardBytes(copy)) << "a copy of a view depends on the memory";
    }
  }
}

TYPED_TEST(ZeroCopyMessage, ATruncatedMessageIsRefused)
{
  TypeParam standard;
  Filler(5, 2000).fill(&standard);
  std::vector<uint8_t> bytes = standardBytes(standard);
  for (size_t length = 0; length + 4 < bytes.size(); length += 1 + length / 16)
  {
    Message<TypeParam> message;
    const ViewScope scope(bytes.data() + 4, length);
    ros::serialization::IStream stream(bytes.data() + 4, static_cast<uint32_t>(length));
    EXPECT_THROW(ros::serialization::deserialize(stream, message), ros::serialization::StreamOverrunException);
  }
}

// ------------------------------------------------------------------------------------------------- where arrays lie

TEST(ZeroCopyLoan, TheLargeArrayIsSentFromWhereItWasWritten)
{
  auto loan = Loan<sensor_msgs::Image>::borrow();
  loan->data.resize(100000);
  const uint8_t* const written = loan->data.data();
  EXPECT_EQ(0U, reinterpret_cast<uintptr_t>(written) % Arena::ALIGNMENT);
  loan->header.frame_id = "camera";
  loan->encoding = "mono8";
  TopicCounters counters("test", true);
  const ros::SerializedMessage message = loan.serialise(&counters);
  EXPECT_GE(written, message.buf.get());
  EXPECT_EQ(message.buf.get() + message.num_bytes, written + 100000);
  EXPECT_EQ(1U, counters.read().in_place);
}

TEST(ZeroCopyLoan, StringsMayGrowAfterTheArrayWasWritten)
{
  for (const size_t length : {0, 1, 63, 64, 65, 500, 900})
  {
    auto loan = Loan<sensor_msgs::PointCloud2>::borrow();
    loan->data.assign(5000, 9);
    const uint8_t* const written = loan->data.data();
    loan->header.frame_id.assign(length, 'f');
    TopicCounters counters("test", true);
    const ros::SerializedMessage message = loan.serialise(&counters);
    EXPECT_EQ(1U, counters.read().in_place) << length;
    EXPECT_EQ(message.buf.get() + message.num_bytes, written + 5000 + 1);
  }
}

TEST(ZeroCopyLoan, WhatDoesNotFitAroundTheArrayIsCopiedAndCounted)
{
  sensor_msgs::Image standard;
  standard.header.frame_id.assign(2000, 'f');
  standard.data.assign(5000, 9);
  auto loan = Loan<sensor_msgs::Image>::borrow();
  loan->header.frame_id.assign(2000, 'f');
  loan->data.assign(5000, 9);
  TopicCounters counters("test", true);
  EXPECT_EQ(standardBytes(standard), bytesOf(loan.serialise(&counters)));
  EXPECT_EQ(1U, counters.read().no_room);
  EXPECT_EQ(0U, counters.read().in_place);
}

TEST(ZeroCopyLoan, ASecondLargeArrayIsCopiedAndCounted)
{
  sensor_msgs::LaserScan standard;
  auto loan = Loan<sensor_msgs::LaserScan>::borrow();
  standard.ranges.assign(3000, 1.0F);
  loan->ranges.assign(3000, 1.0F);
  standard.intensities.assign(9000, 2.0F);
  loan->intensities.assign(9000, 2.0F);
  TopicCounters counters("test", true);
  EXPECT_EQ(standardBytes(standard), bytesOf(loan.serialise(&counters)));
  EXPECT_EQ(1U, counters.read().no_room);
}

TEST(ZeroCopyLoan, AnArrayMayGrowAndShrink)
{
  sensor_msgs::Image standard;
  auto loan = Loan<sensor_msgs::Image>::borrow();
  for (uint32_t i = 0; i < 50000; ++i)
  {
    standard.data.push_back(static_cast<uint8_t>(i));
    loan->data.push_back(static_cast<uint8_t>(i));
  }
  standard.data.resize(20000);
  loan->data.resize(20000);
  TopicCounters counters("test", true);
  EXPECT_EQ(standardBytes(standard), bytesOf(loan.serialise(&counters)));
  EXPECT_EQ(1U, counters.read().in_place);
}

TEST(ZeroCopyLoan, NestedMessagesAreInPlaceToo)
{
  auto loan = Loan<stereo_msgs::DisparityImage>::borrow();
  loan->image.data.resize(30000);
  TopicCounters counters("test", true);
  loan.serialise(&counters);
  EXPECT_EQ(1U, counters.read().in_place);
}

TEST(ZeroCopyLoan, WhatWasSerialisedOutlivesTheLoan)
{
  auto loan = Loan<sensor_msgs::Image>::borrow();
  loan->data.assign(5000, 7);
  TopicCounters counters("test", true);
  const ros::SerializedMessage message = loan.serialise(&counters);
  const std::vector<uint8_t> before = bytesOf(message);
  loan.reset();
  EXPECT_FALSE(loan);
  EXPECT_EQ(before, bytesOf(message));
}

TEST(ZeroCopyLoan, AFieldThatWasMovedOutStaysValid)
{
  std::vector<uint8_t, Allocator<uint8_t>> data;
  {
    auto loan = Loan<sensor_msgs::Image>::borrow();
    loan->data.assign(5000, 7);
    data = std::move(loan->data);
  }
  EXPECT_EQ(5000, std::count(data.begin(), data.end(), 7));
}

TEST(ZeroCopyLoan, MovesBetweenThreads)
{
  auto loan = Loan<sensor_msgs::Image>::borrow();
  std::thread(
      [moved = std::move(loan)]() mutable
      {
        moved->data.assign(100000, 1);
        moved.reset();
      })
      .join();
  EXPECT_FALSE(loan);
}

// ------------------------------------------------------------------------------------------------------------- views

template <typename M>
Message<M> viewOf(const ros::SerializedMessage& message)
{
  const uint32_t length = static_cast<uint32_t>(message.num_bytes - 4);
  const ViewScope scope(message.message_start, length);
  ros::serialization::IStream stream(message.message_start, length);
  Message<M> viewed;
  ros::serialization::deserialize(stream, viewed);
  return viewed;
}

TEST(ZeroCopyView, ArraysOfALoanAreViewsWhateverTheirTypeAndWhatPrecedesThem)
{
  for (size_t length = 0; length < 70; ++length)
  {
    auto loan = Loan<std_msgs::UInt64MultiArray>::borrow();
    loan->layout.dim.resize(1);
    loan->layout.dim[0].label.assign(length, 'x');
    loan->data.assign(1000, 42);
    TopicCounters counters("test", true);
    const auto viewed = viewOf<std_msgs::UInt64MultiArray>(loan.serialise(&counters));
    EXPECT_EQ(loan->data.data(), viewed.data.data()) << length;
    EXPECT_TRUE(isView(viewed.data));
  }
}

TEST(ZeroCopyView, ArraysOfPlainMessagesAreViews)
{
  auto loan = Loan<geometry_msgs::PoseArray>::borrow();
  loan->poses.resize(500);
  Filler filler(1, 500);
  filler.fill(loan.get());
  TopicCounters counters("test", true);
  const auto viewed = viewOf<geometry_msgs::PoseArray>(loan.serialise(&counters));
  EXPECT_EQ(loan->poses.data(), viewed.poses.data());
}

TEST(ZeroCopyView, MisalignedArraysAreCopied)
{
  std_msgs::Float32MultiArray standard;
  standard.data.assign(1000, 2.5F);
  std::vector<uint8_t> bytes = standardBytes(standard);
  std::vector<uint8_t> memory(bytes.size() + 8);
  const size_t array = bytes.size() - 4000;
  uint32_t views = 0;
  for (size_t shift = 0; shift < 4; ++shift)
  {
    std::copy(bytes.begin(), bytes.end(), memory.begin() + static_cast<std::ptrdiff_t>(shift));
    uint8_t* const message = memory.data() + shift + 4;
    const ViewScope scope(message, bytes.size() - 4);
    ros::serialization::IStream stream(message, static_cast<uint32_t>(bytes.size() - 4));
    Message<std_msgs::Float32MultiArray> viewed;
    ros::serialization::deserialize(stream, viewed);
    const bool aligned = reinterpret_cast<uintptr_t>(memory.data() + shift + array) % alignof(float) == 0;
    EXPECT_EQ(aligned, isView(viewed.data));
    EXPECT_EQ(aligned ? 0U : 1U, scope.misaligned());
    EXPECT_EQ(1000, std::count(viewed.data.begin(), viewed.data.end(), 2.5F));
    views += scope.views();
  }
  EXPECT_EQ(1U, views);
}

TEST(ZeroCopyView, WithoutAScopeNothingIsAView)
{
  auto loan = Loan<sensor_msgs::Image>::borrow();
  loan->data.assign(5000, 7);
  TopicCounters counters("test", true);
  const ros::SerializedMessage message = loan.serialise(&counters);
  Message<sensor_msgs::Image> copied;
  ros::serialization::deserializeMessage(message, copied);
  EXPECT_FALSE(isView(copied.data));
}

TEST(ZeroCopyView, ALengthBeyondTheMessageAllocatesNothing)
{
  sensor_msgs::Image standard;
  standard.data.resize(2000);
  std::vector<uint8_t> bytes = standardBytes(standard);
  const uint32_t absurd = 0xfffffff0;
  std::memcpy(bytes.data() + bytes.size() - 2004, &absurd, sizeof(absurd));
  Message<sensor_msgs::Image> message;
  ros::serialization::IStream stream(bytes.data() + 4, static_cast<uint32_t>(bytes.size() - 4));
  EXPECT_THROW(ros::serialization::deserialize(stream, message), ros::serialization::StreamOverrunException);
  EXPECT_EQ(0U, message.data.capacity());
}

template <typename M, typename ArrayOf>
void expectNoBelief(const M& standard, size_t count_at, ArrayOf array_of)
{
  std::vector<uint8_t> bytes = standardBytes(standard);
  const uint32_t absurd = 0x10000000;
  std::memcpy(bytes.data() + bytes.size() - count_at, &absurd, sizeof(absurd));
  Message<M> message;
  ros::serialization::IStream stream(bytes.data() + 4, static_cast<uint32_t>(bytes.size() - 4));
  EXPECT_THROW(ros::serialization::deserialize(stream, message), ros::serialization::StreamOverrunException);
  EXPECT_EQ(0U, array_of(message).capacity());
}

TEST(ZeroCopyView, ACountBeyondTheMessageAllocatesNothing)
{
  expectNoBelief(
      geometry_msgs::PoseArray(), 4, [](const auto& message) -> const auto& { return message.poses; });
  expectNoBelief(
      nav_msgs::Path(), 4, [](const auto& message) -> const auto& { return message.poses; });
  expectNoBelief(
      sensor_msgs::MultiEchoLaserScan(), 8, [](const auto& message) -> const auto& { return message.ranges; });
}

TEST(ZeroCopyView, AGrowingCopyLeavesTheViewedMemory)
{
  auto loan = Loan<sensor_msgs::Image>::borrow();
  loan->data.assign(5000, 7);
  TopicCounters counters("test", true);
  auto viewed = viewOf<sensor_msgs::Image>(loan.serialise(&counters));
  viewed.data.push_back(8);
  EXPECT_FALSE(isView(viewed.data));
  EXPECT_EQ(5001U, viewed.data.size());
  EXPECT_EQ(7, viewed.data.front());
}

TEST(ZeroCopyView, SubscribersInTheSameProcessSeeTheLoanItself)
{
  expectMessagesToHold();
  auto loan = Loan<sensor_msgs::Image>::borrow();
  loan->data.assign(5000, 7);
  const uint8_t* const written = loan->data.data();
  TopicCounters counters("test", true);
  ros::SerializedMessage message = loan.serialise(&counters);
  loan.reset();
  const auto handle = receive<Message<sensor_msgs::Image>>(message.message_start,
                                                           static_cast<uint32_t>(message.num_bytes - 4), &counters);
  message = ros::SerializedMessage();
  EXPECT_EQ(written, handle->data.data());
  EXPECT_EQ(5000, std::count(handle->data.begin(), handle->data.end(), 7));
  EXPECT_EQ(1U, counters.read().viewed);
}

TEST(ZeroCopyView, MessagesThatNobodyHoldsAreCopied)
{
  sensor_msgs::Image standard;
  standard.data.assign(5000, 7);
  std::vector<uint8_t> bytes = standardBytes(standard);
  TopicCounters counters("test", false);
  const auto handle =
      receive<Message<sensor_msgs::Image>>(bytes.data() + 4, static_cast<uint32_t>(bytes.size() - 4), &counters);
  bytes.assign(bytes.size(), 0);
  EXPECT_EQ(5000, std::count(handle->data.begin(), handle->data.end(), 7));
  EXPECT_EQ(1U, counters.read().copied);
}

TEST(ZeroCopyStatistics, NameTopicDirectionAndNumbers)
{
  const auto counters = countersOf("/camera", true);
  counters->countSent(TopicCounters::IN_PLACE, true);
  EXPECT_EQ(counters, countersOf("/camera", true));
  EXPECT_NE(counters, countersOf("/camera", false));
  EXPECT_EQ(
      "/camera: published 1 in place (1 of them not in shared memory), 0 copied (0 small, 0 without room around "
      "the array)",
      counters->read().toString());
}

}  // namespace
}  // namespace pi_os_transport::zero_copy
