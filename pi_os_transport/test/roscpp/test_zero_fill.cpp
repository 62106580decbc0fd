// Messages whose arrays are not filled with zeros before they are overwritten, deserialised by roscpp as a subscriber
// does. The allocator marks the memory that it hands out, so a byte that nobody wrote is seen.

#include <gtest/gtest.h>
#include <malloc.h>
#include <ros/message_deserializer.h>
#include <ros/subscription_callback_helper.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/LaserScan.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Float32MultiArray.h>
#include <std_msgs/UInt8MultiArray.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <memory>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "preload/hooks.h"

namespace zero_fill_test
{

// A sanitizer has a memset() and an operator new of its own, before those of the library.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool SKIPPED = false;
#else
constexpr bool SKIPPED = true;
#endif

constexpr size_t LARGE = 100000;  // [B], more than PI_OS_ZERO_FILL_MIN

/// Called while the message is deserialised, between its two arrays.
std::function<void()> between;

/// Two arrays, and whether they held zeros before they were overwritten.
template <class Bytes>
struct Content
{
  Bytes first;
  Bytes second;
  bool first_was_zero = false;
  bool second_was_zero = false;
};

/// Like a message that genmsg generated.
template <class Allocator>
struct Probe_ : Content<std::vector<uint8_t, typename std::allocator_traits<Allocator>::template rebind_alloc<uint8_t>>>
{
};
using Probe = Probe_<std::allocator<void>>;

/// A type of the user's own.
struct OwnType : Content<std::vector<uint8_t>>
{
};

/// An allocator of the user's own, with the standard one's memory.
template <class T>
struct OwnAllocator : std::allocator<T>
{
  OwnAllocator() = default;
  template <class U>
  OwnAllocator(const OwnAllocator<U>&)
  {
  }
  template <class U>
  struct rebind
  {
    using other = OwnAllocator<U>;
  };
};
using OwnlyAllocated = Probe_<OwnAllocator<uint8_t>>;

template <class Bytes>
bool isZero(const Bytes& bytes)
{
  return std::all_of(bytes.begin(), bytes.end(), [](uint8_t byte) { return byte == 0; });
}

template <class Stream, class Bytes>
void readArray(Stream& stream, Bytes* bytes, bool* was_zero)
{
  uint32_t length = 0;
  stream.next(length);
  bytes->resize(length);
  *was_zero = isZero(*bytes);
  std::memcpy(bytes->data(), stream.advance(length), length);
}

template <class Message>
struct ProbeSerializer
{
  template <class Stream>
  static void read(Stream& stream, Message& message)
  {
    readArray(stream, &message.first, &message.first_was_zero);
    if (between)
    {
      std::exchange(between, nullptr)();
    }
    readArray(stream, &message.second, &message.second_was_zero);
  }
};

}  // namespace zero_fill_test

namespace ros::serialization
{
template <class Allocator>
struct Serializer<zero_fill_test::Probe_<Allocator>>
  : zero_fill_test::ProbeSerializer<zero_fill_test::Probe_<Allocator>>
{
};
template <>
struct Serializer<zero_fill_test::OwnType> : zero_fill_test::ProbeSerializer<zero_fill_test::OwnType>
{
};
}  // namespace ros::serialization

namespace zero_fill_test
{
namespace
{

using Bytes = std::vector<uint8_t>;
template <class M>
using Helper = ros::SubscriptionCallbackHelperT<const boost::shared_ptr<M const>&>;

/// The serialised form of a message with two arrays, whose lengths may be claimed to be others.
Bytes probe(size_t first, size_t second, size_t claimed_second)
{
  Bytes bytes(8 + first + second);
  std::fill(bytes.begin(), bytes.end(), 7);
  const uint32_t lengths[] = {static_cast<uint32_t>(first), static_cast<uint32_t>(claimed_second)};
  std::memcpy(bytes.data(), &lengths[0], 4);
  std::memcpy(bytes.data() + 4 + first, &lengths[1], 4);
  return bytes;
}

Bytes probe(size_t first, size_t second)
{
  return probe(first, second, second);
}

/// What a callback gets; null: nothing.
template <class M>
boost::shared_ptr<M const> receive(const Bytes& bytes, const ros::SubscriptionCallbackHelperPtr& helper)
{
  const boost::shared_array<uint8_t> buffer(new uint8_t[bytes.size()]);
  std::copy(bytes.begin(), bytes.end(), buffer.get());
  ros::SerializedMessage message(buffer, bytes.size());
  message.message_start = buffer.get();
  ros::MessageDeserializer deserializer(helper, message, boost::make_shared<ros::M_string>());
  return boost::static_pointer_cast<M const>(deserializer.deserialize());
}

template <class M>
boost::shared_ptr<M const> receive(const Bytes& bytes)
{
  return receive<M>(bytes, boost::make_shared<Helper<M>>([](const boost::shared_ptr<M const>&) {}));
}

template <class M>
Bytes serialise(const M& message)
{
  Bytes bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

template <class Array>
void number(Array* array, size_t count)
{
  array->resize(count);
  for (size_t i = 0; i < count; ++i)
  {
    (*array)[i] = static_cast<typename Array::value_type>(i * 31 % 251);
  }
}

template <class M>
bool isIntact(const M& message)
{
  const boost::shared_ptr<M const> received = receive<M>(serialise(message));
  return received && serialise(*received) == serialise(message);
}

class ZeroFill : public testing::Test
{
protected:
  ZeroFill() { mallopt(M_PERTURB, 0x5a); }
  ~ZeroFill() override { mallopt(M_PERTURB, 0); }
};

TEST_F(ZeroFill, IsSkippedWhereTheMessageOverwritesIt)
{
  const auto message = receive<Probe>(probe(LARGE, 3 * LARGE));
  ASSERT_TRUE(message);
  EXPECT_EQ(message->first_was_zero, !SKIPPED);
  EXPECT_EQ(message->second_was_zero, !SKIPPED);
  EXPECT_EQ(message->first, Bytes(LARGE, 7));
  EXPECT_EQ(message->second, Bytes(3 * LARGE, 7));
}

TEST_F(ZeroFill, IsDoneForShortArrays)
{
  const auto message = receive<Probe>(probe(PI_OS_ZERO_FILL_MIN - 1, PI_OS_ZERO_FILL_MIN));
  ASSERT_TRUE(message);
  EXPECT_TRUE(message->first_was_zero);
  EXPECT_EQ(message->second_was_zero, !SKIPPED);
}

TEST_F(ZeroFill, IsDoneForATypeOfTheUsersOwn)
{
  const auto message = receive<OwnType>(probe(LARGE, LARGE));
  ASSERT_TRUE(message);
  EXPECT_TRUE(message->first_was_zero && message->second_was_zero);
}

TEST_F(ZeroFill, IsDoneForAnAllocatorOfTheUsersOwn)
{
  const auto message = receive<OwnlyAllocated>(probe(LARGE, LARGE));
  ASSERT_TRUE(message);
  EXPECT_TRUE(message->first_was_zero && message->second_was_zero);
}

TEST_F(ZeroFill, IsDoneForAFactoryOfTheUsersOwn)
{
  bool scratch_was_zero = false;
  const auto make = [&scratch_was_zero]()
  {
    scratch_was_zero = isZero(Bytes(LARGE));
    return boost::make_shared<Probe>();
  };
  const auto message = receive<Probe>(
      probe(LARGE, LARGE), boost::make_shared<Helper<Probe>>([](const boost::shared_ptr<Probe const>&) {}, make));
  ASSERT_TRUE(message);
  EXPECT_TRUE(scratch_was_zero && message->first_was_zero && message->second_was_zero);
}

/// A helper of the user's own is not asked for what only roscpp's has.
class OwnHelper : public ros::SubscriptionCallbackHelper
{
public:
  ros::VoidConstPtr deserialize(const ros::SubscriptionCallbackHelperDeserializeParams&) override
  {
    return boost::make_shared<Bytes>(LARGE);
  }
  void call(ros::SubscriptionCallbackHelperCallParams&) override {}
  const std::type_info& getTypeInfo() override { return typeid(Probe); }
  bool isConst() override { return true; }
  bool hasHeader() override { return false; }
};

TEST_F(ZeroFill, IsDoneForAHelperOfTheUsersOwn)
{
  const auto message = receive<Bytes>(probe(LARGE, LARGE), boost::make_shared<OwnHelper>());
  ASSERT_TRUE(message);
  EXPECT_TRUE(isZero(*message));
}

TEST_F(ZeroFill, NoMessageIsMadeOfAnArrayLongerThanTheMessage)
{
  for (const size_t claimed : {LARGE + 1, LARGE + 4, 2 * LARGE + 8, 2 * LARGE + 9, size_t{50000000}})
  {
    EXPECT_FALSE(receive<Probe>(probe(LARGE, LARGE, claimed))) << claimed;
    sensor_msgs::Image image;
    number(&image.data, LARGE);
    Bytes bytes = serialise(image);
    const auto length = static_cast<uint32_t>(claimed);
    std::memcpy(bytes.data() + bytes.size() - LARGE - 4, &length, 4);
    EXPECT_FALSE(receive<sensor_msgs::Image>(bytes)) << claimed;
  }
}

TEST_F(ZeroFill, IsDoneAgainBehindAnException)
{
  between = []() { throw std::runtime_error("in the middle"); };
  EXPECT_FALSE(receive<Probe>(probe(LARGE, LARGE)));
  EXPECT_TRUE(isZero(Bytes(LARGE)));
  between = []() { throw 1; };
  EXPECT_THROW(receive<Probe>(probe(LARGE, LARGE)), int);
  EXPECT_TRUE(isZero(Bytes(LARGE)));
  EXPECT_EQ(receive<Probe>(probe(LARGE, LARGE))->first_was_zero, !SKIPPED);
}

TEST_F(ZeroFill, IsSkippedAroundAMessageWithinAMessage)
{
  boost::shared_ptr<OwnType const> inner;
  between = [&inner]() { inner = receive<OwnType>(probe(LARGE, LARGE)); };
  const auto outer = receive<Probe>(probe(2 * LARGE, 2 * LARGE));
  ASSERT_TRUE(inner && outer);
  EXPECT_TRUE(inner->first_was_zero && inner->second_was_zero);
  EXPECT_EQ(outer->first_was_zero, !SKIPPED);
  EXPECT_EQ(outer->second_was_zero, !SKIPPED);
  EXPECT_EQ(inner->second, Bytes(LARGE, 7));
  EXPECT_EQ(outer->second, Bytes(2 * LARGE, 7));
}

TEST_F(ZeroFill, IsDoneInOtherThreadsMeanwhile)
{
  bool was_zero = false;
  between = [&was_zero]() { std::thread([&was_zero]() { was_zero = isZero(Bytes(LARGE)); }).join(); };
  ASSERT_TRUE(receive<Probe>(probe(LARGE, LARGE)));
  EXPECT_TRUE(was_zero);
}

TEST_F(ZeroFill, OnlyTheFillOfTheWholeNewArrayIsSkipped)
{
  between = []()
  {
    const std::unique_ptr<uint8_t, void (*)(void*)> array(static_cast<uint8_t*>(operator new(LARGE)),
                                                          [](void* memory) { operator delete(memory); });
    const auto clear = [&array](size_t from, size_t bytes) { std::memset(array.get() + from, 0, bytes); };
    const auto is_zero = [&array](size_t from, size_t bytes)
    { return std::all_of(array.get() + from, array.get() + from + bytes, [](uint8_t byte) { return byte == 0; }); };
    std::memset(array.get(), 1, LARGE);
    EXPECT_EQ(array.get()[LARGE - 1], 1);
    clear(0, LARGE - 1);
    EXPECT_TRUE(is_zero(0, LARGE - 1));
    EXPECT_EQ(array.get()[LARGE - 1], 1);
    std::memset(array.get(), 1, LARGE);
    clear(9, LARGE - 9);
    EXPECT_TRUE(is_zero(9, LARGE - 9));
    std::memset(array.get(), 1, LARGE);
    clear(0, LARGE);
    EXPECT_EQ(is_zero(0, LARGE), !SKIPPED);
    clear(0, LARGE);  // a second fill has another reason
    EXPECT_TRUE(is_zero(0, LARGE));
  };
  ASSERT_TRUE(receive<Probe>(probe(LARGE, LARGE)));
}

TEST_F(ZeroFill, NoByteOfARealMessageIsWrong)
{
  for (const size_t count : {size_t{0}, size_t{1}, size_t{65535}, size_t{65536}, size_t{65537}, size_t{6220800}})
  {
    sensor_msgs::Image image;
    image.encoding = "8UC1";
    number(&image.data, count);
    EXPECT_TRUE(isIntact(image)) << count;
    sensor_msgs::CompressedImage compressed;
    number(&compressed.data, count);
    EXPECT_TRUE(isIntact(compressed)) << count;
    sensor_msgs::PointCloud2 cloud;
    cloud.fields.resize(3);
    number(&cloud.data, count);
    EXPECT_TRUE(isIntact(cloud)) << count;
    std_msgs::UInt8MultiArray bytes;
    bytes.layout.dim.resize(5000);
    number(&bytes.data, count);
    EXPECT_TRUE(isIntact(bytes)) << count;
    std_msgs::Float32MultiArray floats;
    number(&floats.data, count);
    EXPECT_TRUE(isIntact(floats)) << count;
    sensor_msgs::LaserScan scan;
    number(&scan.ranges, count);
    number(&scan.intensities, count / 2);
    EXPECT_TRUE(isIntact(scan)) << count;
  }
}

}  // namespace
}  // namespace zero_fill_test
