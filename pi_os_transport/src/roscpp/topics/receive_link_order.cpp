// What a subscriber gets over TCPROS, in order with what it gets from a ring. Compiled without access control, like
// roscpp_hooks.cpp.

#include "roscpp/topics/numbered_message.h"
#include "roscpp/topics/receive_link.h"

namespace pi_os_transport
{

void ReceiveLink::deliverTcp(ros::TransportPublisherLink* link, const ros::SerializedMessage& message)
{
  std::lock_guard<std::recursive_mutex> lock(mutex_);
  if (started_ && static_cast<int32_t>(tcp_delivered_ - tcp_before_start_) >= 0)
  {
    leaveBridge(LinkEnd::BACK_TO_TCP);  // the publisher has gone back to TCPROS
  }
  drain(Drain::ALL_DUE);  // what the publisher wrote before this message
  ros::SerializedMessage plain = message;
  const std::optional<uint32_t> number = takeNumber(link_token_, 0, &plain);
  if (link != nullptr && (!number || isNew(*number)))
  {
    Runtime::instance().original.handle_message(link, plain, true, false);
  }
  ++tcp_delivered_;
  drain(Drain::BATCH);
}

/// False for a message of a bridge that was delivered before; counts those that are missing before a new one.
bool ReceiveLink::isNew(uint32_t number)
{
  const auto ahead = static_cast<int32_t>(number - last_number_);
  if (ahead <= 0)
  {
    return false;
  }
  missing_ += static_cast<uint64_t>(ahead - 1);
  last_number_ = number;
  return true;
}

}  // namespace pi_os_transport
