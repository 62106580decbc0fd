// The calls of a ServiceCaller.

#include <ros/console.h>

#include <cstring>
#include <string>

#include "roscpp/services/service_caller.h"
#include "roscpp/services/tcp_calls.h"
#include "roscpp/topics/fetched_message.h"

namespace pi_os_transport
{
namespace
{

/// A first request of at least this size waits for shared memory; TCPROS is faster for a smaller one [B].
constexpr size_t WORTH_WAITING = 64 << 10;

/// True if `request` has the form of TCPROS: its length, then as many bytes.
bool isFramed(const ros::SerializedMessage& request)
{
  uint32_t length = 0;
  if (request.num_bytes < LENGTH_PREFIX)
  {
    return false;
  }
  std::memcpy(&length, request.buf.get(), sizeof(length));
  return length == request.num_bytes - LENGTH_PREFIX;
}

}  // namespace

bool ServiceCaller::send(const ros::SerializedMessage& request, uint64_t number)
{
  SlotPool& pool = Runtime::instance().pool();
  uint8_t* const buffer = pool.allocate(request.num_bytes);
  if (buffer == nullptr)
  {
    return false;
  }
  std::memcpy(buffer, request.buf.get(), request.num_bytes);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    taken_back_ = false;
    if (requests_ && requests_->push(buffer, static_cast<uint32_t>(request.num_bytes - LENGTH_PREFIX), 0, 0, number) ==
                         RingSender::Push::WRITTEN)
    {
      return true;
    }
  }
  pool.release(buffer);
  return false;
}

ServiceCaller::Outcome ServiceCaller::call(ros::ServiceServerLink* link, const ros::SerializedMessage& request,
                                           ros::SerializedMessage& response, bool tcp_too)
{
  Runtime& runtime = Runtime::instance();
  std::lock_guard<std::mutex> one_at_a_time(call_mutex_);
  // If the connection ended before it had a drop listener, nobody would end the negotiation.
  const ros::ConnectionPtr connection = connection_.lock();
  if (request.num_bytes >= WORTH_WAITING && connection && !connection->isDropped())
  {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this]() { return state_ != State::NEGOTIATING; });
  }
  std::shared_ptr<RingReceiver> answers;
  if (state_ == State::READY && isFramed(request) && request.num_bytes - LENGTH_PREFIX >= runtime.options.min_bytes)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    answers = answers_;
  }
  const uint64_t start_ns = answers ? monotonicNs() : 0;
  if (!answers || !send(request, ++calls_))
  {
    if (answers && state_ == State::READY)
    {
      statistics_->update([](ServiceCounts* counts) { ++counts->pool_full; });
    }
    return tcp_too ? fallBackToTcp(link, request, response) : Outcome::NOT_TAKEN;
  }
  const Outcome outcome = awaitAnswer(link, answers, calls_, response);
  if (outcome == Outcome::NOT_TAKEN && state_ == State::REFUSED && tcp_too)
  {
    return fallBackToTcp(link, request, response);
  }
  if (tcp_too || outcome != Outcome::NOT_TAKEN)
  {
    statistics_->update(
        [&](ServiceCounts* counts)
        {
          ++counts->memory;
          counts->failed += outcome != Outcome::SUCCESS ? 1 : 0;
          counts->durations.addSince(start_ns);
        });
  }
  runtime.announceRetired();
  return outcome;
}

ServiceCaller::Outcome ServiceCaller::fallBackToTcp(ros::ServiceServerLink* link, const ros::SerializedMessage& request,
                                                    ros::SerializedMessage& response)
{
  const bool ok = callOverTcp(link, request, response);
  statistics_->update(
      [&](ServiceCounts* counts)
      {
        ++counts->tcp;
        counts->failed += ok ? 0 : 1;
        counts->fallback = state_ == State::READY ? Fallback::NONE : fallback_.load();
      });
  return ok ? Outcome::SUCCESS : Outcome::FAILURE;
}

ServiceCaller::Outcome ServiceCaller::awaitAnswer(ros::ServiceServerLink* link,
                                                  const std::shared_ptr<RingReceiver>& answers, uint64_t number,
                                                  ros::SerializedMessage& response)
{
  for (;;)
  {
    const bool last_look = state_ != State::READY;
    RingReceiver::Message message;
    RingReceiver::Take take = RingReceiver::Take::EMPTY;
    boost::shared_array<uint8_t> body;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      take = answers->take(0, true, &message);
      if (take == RingReceiver::Take::WAITING && !last_look)
      {
        const uint64_t served = served_;
        changed_.wait(lock, [&]() { return served_ != served || state_ != State::READY; });
        continue;
      }
      if (take == RingReceiver::Take::TAKEN && message.descriptor.segment == Descriptor::LINK_START)
      {
        answers->release(message.ticket);
      }
      else if (take == RingReceiver::Take::TAKEN)
      {
        body = fetchMessage(answers, message, &copied_);
      }
    }
    const Descriptor& descriptor = message.descriptor;
    if (take == RingReceiver::Take::EMPTY && !last_look)
    {
      if (state_ == State::READY)  // who changes it from now on disturbs the sleep
      {
        answers->sleep();
      }
      continue;
    }
    if (take != RingReceiver::Take::TAKEN)
    {
      return giveUp(link);
    }
    if (descriptor.segment == Descriptor::LINK_START)
    {
      return awaitTcpAnswer(link, response) ? Outcome::SUCCESS : Outcome::FAILURE;
    }
    if (descriptor.serial >> 1 != number)
    {
      continue;  // answer to an older call
    }
    if (!body)
    {
      ROS_ERROR("Service call failed: the answer of [%s], %u bytes in shared memory, cannot be read",
                link->getServiceName().c_str(), descriptor.length);
      return Outcome::FAILURE;
    }
    if ((descriptor.serial & 1) != 0)
    {
      response = ros::SerializedMessage(body, descriptor.length);
      return Outcome::SUCCESS;
    }
    if (descriptor.length > 0)
    {
      // Like ServiceServerLink::call.
      ROS_ERROR("Service call failed: service [%s] responded with an error: %s", link->getServiceName().c_str(),
                std::string(reinterpret_cast<const char*>(body.get()), descriptor.length).c_str());
    }
    return Outcome::FAILURE;
  }
}

ServiceCaller::Outcome ServiceCaller::giveUp(ros::ServiceServerLink* link)
{
  bool taken_back = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (requests_)
    {
      takeBackRequest();
    }
    taken_back = taken_back_;
  }
  const ros::ConnectionPtr connection = connection_.lock();
  if (connection && !(taken_back && state_ == State::REFUSED))
  {
    connection->drop(ros::Connection::TransportDisconnect);
    endCalls(link);  // makes the client's handle invalid
  }
  return taken_back ? Outcome::NOT_TAKEN : Outcome::FAILURE;
}

}  // namespace pi_os_transport
