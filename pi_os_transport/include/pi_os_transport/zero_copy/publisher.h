#pragma once

#include <ros/node_handle.h>
#include <ros/publisher.h>

#include <boost/function.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "pi_os_transport/zero_copy/loan.h"
#include "pi_os_transport/zero_copy/message.h"
#include "pi_os_transport/zero_copy/statistics.h"

namespace pi_os_transport::zero_copy
{

/// What roscpp publishes: a function that returns the bytes of a message.
struct PublishedLoan
{
  boost::function<ros::SerializedMessage()> serialise;
};

/// Publishes messages of type M. The user writes a message where subscribers read it. Unmodified subscribers, TCPROS,
/// rospy, rosbag and bridges get the same bytes as from a ros::Publisher.
///
/// Without libpi_os_transport in the process, it uses TCPROS. Copies share one publisher, like copies of
/// ros::Publisher. Thread safe.
template <typename M>
class Publisher
{
public:
  /// Publishes nothing.
  Publisher() = default;
  /// @throws like ros::NodeHandle::advertise().
  Publisher(ros::NodeHandle& node, const std::string& topic, uint32_t queue_size, bool latch = false)
    : Publisher(node.advertise<M>(topic, queue_size, latch))
  {
  }
  /// Uses a publisher of M that was advertised elsewhere.
  explicit Publisher(const ros::Publisher& publisher)
    : publisher_(publisher), counters_(publisher ? countersOf(publisher.getTopic(), true) : nullptr)
  {
  }

  /// A message to fill. Costs two small allocations; resizing its arrays allocates the large memory.
  Loan<M> borrow() const { return Loan<M>::borrow(); }

  /// Sends the message; the loan is empty afterwards.
  void publish(Loan<M>&& loan) const
  {
    const Loan<M> message = std::move(loan);
    if (message && publisher_)
    {
      publisher_.publish(PublishedLoan{[&]() { return message.serialise(counters_.get()); }});
    }
  }
  /// Sends any message, like ros::Publisher.
  void publish(const M& message) const
  {
    if (publisher_)
    {
      publisher_.publish(message);
    }
  }

  uint32_t getNumSubscribers() const { return publisher_ ? publisher_.getNumSubscribers() : 0; }
  std::string getTopic() const { return publisher_ ? publisher_.getTopic() : std::string(); }
  const ros::Publisher& rosPublisher() const { return publisher_; }
  explicit operator bool() const { return static_cast<bool>(publisher_); }
  void shutdown() { publisher_.shutdown(); }

  /// The counters of all publishers of the topic in this process.
  TopicStatistics statistics() const { return counters_ ? counters_->read() : TopicStatistics{}; }

private:
  ros::Publisher publisher_;
  std::shared_ptr<TopicCounters> counters_;
};

}  // namespace pi_os_transport::zero_copy

namespace ros
{
namespace message_traits
{

// Any type: Publisher<M> has checked it.
template <>
struct MD5Sum<pi_os_transport::zero_copy::PublishedLoan>
{
  static const char* value() { return "*"; }
  static const char* value(const pi_os_transport::zero_copy::PublishedLoan&) { return value(); }
};

template <>
struct DataType<pi_os_transport::zero_copy::PublishedLoan>
{
  static const char* value() { return "*"; }
  static const char* value(const pi_os_transport::zero_copy::PublishedLoan&) { return value(); }
};

}  // namespace message_traits

namespace serialization
{

template <>
inline SerializedMessage serializeMessage(const pi_os_transport::zero_copy::PublishedLoan& message)
{
  return message.serialise();
}

}  // namespace serialization
}  // namespace ros
