#pragma once

#include "protocol/messages.h"

#include <ros/callback_queue_interface.h>
#include <ros/message_traits.h>
#include <ros/serialization.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <cstring>

namespace pi_web
{

/// A message of any type as its bytes, which clients share. topic_tools::ShapeShifter would copy them once more, and
/// type and definition with every message.
struct RawMessage
{
  Payload bytes;
};

/// Calls the callbacks of roscpp on the thread of a context. Subscribers are ended on that thread, so no callback of an
/// ended one is called.
class IoQueue : public ros::CallbackQueueInterface
{
public:
  explicit IoQueue(boost::asio::io_context* context) : context_(context) {}
  void addCallback(const ros::CallbackInterfacePtr& callback, uint64_t) override
  {
    boost::asio::post(*context_, [callback] { callback->call(); });
  }
  void removeByID(uint64_t) override {}

private:
  boost::asio::io_context* const context_;
};

}  // namespace pi_web

namespace ros::message_traits
{
template <>
struct MD5Sum<pi_web::RawMessage>
{
  static const char* value() { return "*"; }
  static const char* value(const pi_web::RawMessage&) { return "*"; }
};
template <>
struct DataType<pi_web::RawMessage> : MD5Sum<pi_web::RawMessage>
{
};
template <>
struct Definition<pi_web::RawMessage>
{
  static const char* value() { return ""; }
  static const char* value(const pi_web::RawMessage&) { return ""; }
};
template <>
struct IsMessage<pi_web::RawMessage> : TrueType
{
};
}  // namespace ros::message_traits

namespace ros::serialization
{
template <>
struct Serializer<pi_web::RawMessage>
{
  template <typename Stream>
  static void read(Stream& stream, pi_web::RawMessage& message)
  {
    const uint32_t length = stream.getLength();
    const uint8_t* const bytes = stream.advance(length);
    message.bytes = std::make_shared<pi_web::Bytes>(bytes, bytes + length);
  }
  template <typename Stream>
  static void write(Stream& stream, const pi_web::RawMessage& message)
  {
    std::memcpy(stream.advance(static_cast<uint32_t>(message.bytes->size())), message.bytes->data(),
                message.bytes->size());
  }
  static uint32_t serializedLength(const pi_web::RawMessage& message)
  {
    return static_cast<uint32_t>(message.bytes->size());
  }
};
}  // namespace ros::serialization
