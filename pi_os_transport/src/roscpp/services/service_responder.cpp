#include "roscpp/services/service_responder.h"

#include <ros/console.h>
#include <ros/service_publication.h>

#include <cstring>
#include <string>
#include <utility>

#include "roscpp/topics/receive_link.h"
#include "shm/event.h"

namespace pi_os_transport
{
namespace
{

/// A serialised answer starts with the success flag (1 B) and the length of the rest (4 B).
constexpr size_t ANSWER_PREFIX = 5;

}  // namespace

void ServiceResponder::meet(SideChannel answers, SideChannel requests)
{
  Runtime& runtime = Runtime::instance();
  auto ring = std::make_unique<RingSender>(&runtime.pool(), runtime.poolToken(), runtime.leaseBudget());
  std::string error;
  if (!requests || !ring->open(std::move(answers), &error))
  {
    if (!error.empty())
    {
      ROS_WARN("pi_os_transport: no shared memory for a client of a service (%s); its calls stay on TCPROS",
               error.c_str());
    }
    return;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  if (ended_ || answers_ || requests_)
  {
    return;
  }
  answers_ = std::move(ring);
  requests_ = std::make_shared<RingReceiver>(std::move(requests));
  const std::shared_ptr<ServiceResponder> self = shared_from_this();
  runtime.addChannel(self);
  runtime.watch(answers_->channel().fd(), [self](int) { self->onAnswerChannel(); });
  runtime.watch(requests_->fd(), [self](int) { self->onRequestChannel(); });
}

void ServiceResponder::onRequestChannel()
{
  bool was_in_use = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!requests_)
    {
      return;
    }
    const SideChannel::Receive received = requests_->readPackets();
    if (requests_->hasRing() && !in_use_)
    {
      startRequests();
    }
    if (received == SideChannel::Receive::NOTHING)
    {
      return;
    }
    was_in_use = in_use_;
  }
  closeRequests();
  if (was_in_use)
  {
    dropIfSilent(connection_.lock());
  }
}

void ServiceResponder::startRequests()
{
  in_use_ = true;
  const std::shared_ptr<ServiceResponder> self = shared_from_this();
  Runtime::instance().watch(requests_->doorbell(NETWORK_THREAD), [self](int) { self->onDoorbell(); });
  const ros::ServiceClientLinkPtr link = link_.lock();
  const ros::ServicePublicationPtr service = link ? link->parent_.lock() : nullptr;
  if (auto* queue = service ? dynamic_cast<ros::CallbackQueue*>(service->callback_queue_) : nullptr)
  {
    waiter_ = QueueWaiter::of(queue);
  }
  Descriptor descriptor;
  uint32_t ticket;
  requests_->ring().take(0, true, &descriptor, &ticket);  // arms the doorbell: no request comes before the proof
  if (waiter_)
  {
    waiter_->add(self, requests_->doorbell(SPINNER));
  }
  requests_->sendProof();
}

bool ServiceResponder::readProof()
{
  for (;;)
  {
    Packet packet;
    SideChannel::Descriptors descriptors;
    switch (answers_->channel().receive(&packet, &descriptors))
    {
      case SideChannel::Receive::PACKET:
        answers_proven_ |= answers_->isProof(packet);
        break;
      case SideChannel::Receive::NOTHING:
        return true;
      default:
        return false;
    }
  }
}

void ServiceResponder::onAnswerChannel()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!answers_ || readProof())
    {
      return;
    }
  }
  closeAnswers();  // the client reads no more answers
}

void ServiceResponder::onDoorbell()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!in_use_ || !clearEvent(requests_->doorbell(NETWORK_THREAD)))
    {
      return;
    }
  }
  takeRequests(nullptr);
}

void ServiceResponder::serve(Doorbell doorbell)
{
  takeRequests(&doorbell);
}

void ServiceResponder::takeRequests(const Doorbell* doorbell)
{
  for (;;)
  {
    Descriptor descriptor;
    boost::shared_array<uint8_t> body;
    bool in_turn = false;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      uint32_t ticket = 0;
      if (!in_use_)
      {
        return;
      }
      if (doorbell != nullptr)
      {
        requests_->ring().useDoorbell(*doorbell);
      }
      if (requests_->ring().take(0, true, &descriptor, &ticket) != RingConsumer::Take::TAKEN)
      {
        return;
      }
      in_turn = pending_ == 0 && descriptor.serial != 0;
      body = in_turn && descriptor.segment != Descriptor::LINK_START
                 ? ReceiveLink::fetch(requests_, descriptor, ticket, &copied_)
                 : nullptr;
      pending_ = descriptor.serial;
      taken_ns_ = monotonicNs();
    }
    // Without the lock: the queue may run the callback in place, which may end the connection.
    const ros::ServiceClientLinkPtr link = link_.lock();
    const ros::ServicePublicationPtr service = link ? link->parent_.lock() : nullptr;
    if (!body || !service)
    {
      ROS_ERROR_COND(!in_turn,
                     "pi_os_transport: a client sends a request before it has the answer to the one before; "
                     "its connection is closed");
      ROS_ERROR_COND(in_turn && !body,
                     "pi_os_transport: a request of %u bytes in shared memory cannot be read; the call fails",
                     descriptor.length);
      drop();
      return;
    }
    service->processRequest(body, descriptor.length, link);
  }
}

bool ServiceResponder::respond(const ros::SerializedMessage& response)
{
  Runtime& runtime = Runtime::instance();
  SlotPool& pool = runtime.pool();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (pending_ == 0)
    {
      statistics_->update([](ServiceCounts* counts) { ++counts->tcp; });
      return false;
    }
  }
  const bool framed = response.num_bytes >= ANSWER_PREFIX;
  const size_t length = framed ? response.num_bytes - ANSWER_PREFIX : 0;
  uint8_t* const buffer = framed ? pool.allocate(LENGTH_PREFIX + length) : nullptr;
  if (buffer != nullptr)
  {
    std::memcpy(buffer + LENGTH_PREFIX, response.buf.get() + ANSWER_PREFIX, length);
  }
  bool written = false;
  bool announced = false;
  uint64_t taken_ns = 0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    taken_ns = taken_ns_;
    const uint64_t serial = std::exchange(pending_, 0) << 1 | (framed && response.buf[0] != 0 ? 1 : 0);
    if (answers_ && (answers_proven_ || (readProof() && answers_proven_)))
    {
      written = buffer != nullptr &&
                answers_->push(buffer, static_cast<uint32_t>(length), 0, 0, serial) == RingSender::Push::WRITTEN;
      announced = written || answers_->pushStart(0, false, 0);
    }
  }
  if (!written && buffer != nullptr)
  {
    pool.release(buffer);
  }
  statistics_->update(
      [&](ServiceCounts* counts)
      {
        ++counts->memory;
        counts->failed += framed && response.buf[0] != 0 ? 0 : 1;
        counts->pool_full += buffer == nullptr ? 1 : 0;
        counts->durations.addSince(taken_ns);
      });
  const ros::ConnectionPtr connection = connection_.lock();
  if (!announced)
  {
    drop();  // the client cannot be told where the answer is
  }
  else if (!written && connection)
  {
    // roscpp already waits for the next request over TCPROS, so the end of this write must not reach it.
    connection->write(response.buf, static_cast<uint32_t>(response.num_bytes), [](const ros::ConnectionPtr&) {});
  }
  runtime.announceRetired();
  return true;
}

void ServiceResponder::drop()
{
  if (const ros::ConnectionPtr connection = connection_.lock())
  {
    connection->drop(ros::Connection::TransportDisconnect);
  }
}

void ServiceResponder::disconnect()
{
  Runtime::instance().forget(token_);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    ended_ = true;
  }
  closeRequests();
}

void ServiceResponder::closeRequests()
{
  Runtime& runtime = Runtime::instance();
  std::shared_ptr<RingReceiver> requests;  // a lease that still reads keeps it; its end tells the client
  std::shared_ptr<QueueWaiter> waiter;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    requests = std::exchange(requests_, nullptr);
    waiter = std::exchange(waiter_, nullptr);
    if (!requests)
    {
      return;
    }
    runtime.unwatch(requests->fd());
    if (std::exchange(in_use_, false))
    {
      runtime.unwatch(requests->doorbell(NETWORK_THREAD));
    }
  }
  if (waiter)
  {
    waiter->remove(shared_from_this(), requests->doorbell(SPINNER));
  }
}

void ServiceResponder::closeAnswers()
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<ServiceResponder> self = shared_from_this();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!answers_)
    {
      return;
    }
    runtime.unwatch(answers_->channel().fd());
    answers_.reset();
  }
  runtime.removeChannel(self);
  runtime.announceRetired();
}

}  // namespace pi_os_transport
