#pragma once

// Makes roscpp deliver Message<M> without copying its large arrays. With this header included,
//
//   void onImage(const zero_copy::ConstPtr<sensor_msgs::Image>& image);
//   ros::Subscriber subscriber = node.subscribe("image", 1, onImage);
//
// is enough, as is message_filters::Subscriber<zero_copy::Message<sensor_msgs::Image>>. The publisher may be of any
// kind.
//
// An array becomes a view if shared memory or this process delivers the message and the array is aligned for its type.
// Arrays of bytes, and arrays of a zero_copy::Publisher, always are. Otherwise the array is copied. A subscriber that
// holds more than 128 messages, or more than 1/8 of the publisher's pool, gets further messages as copies. See
// zero_copy::statistics().

#include <ros/message_event.h>
#include <ros/parameter_adapter.h>
#include <ros/subscription_callback_helper.h>

#include <boost/function.hpp>
#include <boost/make_shared.hpp>
#include <boost/shared_ptr.hpp>

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <type_traits>
#include <typeinfo>

#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/serialization.h"
#include "pi_os_transport/zero_copy/statistics.h"

namespace pi_os_transport::zero_copy
{

/// Tells the library that this process holds received messages. Call before subscribing.
void expectMessagesToHold();

/// Keeps the message at `message` in place. @return null if this is impossible.
std::shared_ptr<const void> holdMessage(const uint8_t* message);

/// A message and the owner of its arrays.
template <typename Form>
struct HeldMessage
{
  std::shared_ptr<const void> memory;  // destroyed after the message
  Form message;
};

/// @param counters  counts how the message was received.
/// @throws ros::serialization::StreamOverrunException if the bytes are not a message of this type.
template <typename Form>
boost::shared_ptr<Form> receive(uint8_t* bytes, uint32_t length, TopicCounters* counters)
{
  const auto held = boost::make_shared<HeldMessage<Form>>();
  held->memory = holdMessage(bytes);
  ros::serialization::IStream stream(bytes, length);
  if (!held->memory)
  {
    ros::serialization::deserialize(stream, held->message);
    counters->countReceived(TopicCounters::COPIED);
  }
  else
  {
    const ViewScope scope(bytes, length);
    ros::serialization::deserialize(stream, held->message);
    counters->countReceived(scope.misaligned() > 0 ? TopicCounters::MISALIGNED
                            : scope.views() > 0    ? TopicCounters::VIEWED
                                                   : TopicCounters::WITHOUT_LARGE);
    if (scope.views() == 0)
    {
      held->memory.reset();
    }
  }
  return boost::shared_ptr<Form>(held, &held->message);
}

}  // namespace pi_os_transport::zero_copy

namespace ros
{

template <typename P>
class SubscriptionCallbackHelperT<
    P, std::enable_if_t<pi_os_transport::zero_copy::IsZeroCopy<typename ParameterAdapter<P>::Message>::value>>
  : public SubscriptionCallbackHelper
{
public:
  using Adapter = ParameterAdapter<P>;
  using NonConstType = typename Adapter::Message;
  using ConstType = const NonConstType;
  using NonConstTypePtr = boost::shared_ptr<NonConstType>;
  using ConstTypePtr = boost::shared_ptr<ConstType>;
  using Event = typename Adapter::Event;
  using Callback = boost::function<void(typename Adapter::Parameter)>;
  using CreateFunction = boost::function<NonConstTypePtr()>;

  static_assert(Adapter::is_const, "received memory is read-only: take a ConstPtr and copy the message to change it");
  static const bool is_const = true;

  explicit SubscriptionCallbackHelperT(const Callback& callback,
                                       const CreateFunction& create = DefaultMessageCreator<NonConstType>())
    : callback_(callback), create_(create)
  {
    pi_os_transport::zero_copy::expectMessagesToHold();
  }

  void setCreateFunction(const CreateFunction& create) { create_ = create; }

  VoidConstPtr deserialize(const SubscriptionCallbackHelperDeserializeParams& params) override
  {
    std::call_once(counters_made_, [&]() { makeCounters(params.connection_header); });
    return pi_os_transport::zero_copy::receive<NonConstType>(params.buffer, params.length, counters_.get());
  }

  void call(SubscriptionCallbackHelperCallParams& params) override
  {
    Event event(params.event, create_);
    callback_(Adapter::getParameter(event));
  }

  const std::type_info& getTypeInfo() override { return typeid(NonConstType); }
  bool isConst() override { return true; }
  bool hasHeader() override { return message_traits::hasHeader<NonConstType>(); }

private:
  void makeCounters(const boost::shared_ptr<M_string>& connection_header)
  {
    const auto topic = connection_header ? connection_header->find("topic") : M_string::iterator();
    const bool known = connection_header && topic != connection_header->end();
    counters_ = pi_os_transport::zero_copy::countersOf(known ? topic->second : std::string("(this process)"), false);
  }

  Callback callback_;
  CreateFunction create_;
  std::once_flag counters_made_;
  std::shared_ptr<pi_os_transport::zero_copy::TopicCounters> counters_;
};

}  // namespace ros
