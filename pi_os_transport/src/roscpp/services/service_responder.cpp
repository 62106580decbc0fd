#include "roscpp/services/service_responder.h"

#include <ros/console.h>
#include <ros/service_publication.h>

#include <cstring>
#include <string>
#include <utility>

#include "roscpp/services/service_caller.h"
#include "roscpp/topics/fetched_message.h"

namespace pi_os_transport
{
namespace
{

/// A serialised answer starts with the success flag (1 B) and the length of the rest (4 B).
constexpr size_t ANSWER_PREFIX = 5;

}  // namespace

void ServiceResponder::meet(const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<ServiceResponder> self = shared_from_this();
  auto ring = std::make_unique<RingSender>(&runtime.pool(), runtime.leaseBudget());
  std::string error;
  bool wanted = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    wanted = !ended_ && !answers_ && !requests_;
  }
  if (!wanted || !pair->addSender(hello.link, self) || !ring->open(pair, hello.link, &error))
  {
    if (!error.empty())
    {
      runtime.warnOfShortage("no shared memory for a client of a service: " + error);
    }
    pair->removeSender(hello.link, this);
    pair->send(Packet::ended(hello.link, LinkEnd::REFUSED));
    return;
  }
  auto requests = std::make_shared<RingReceiver>(pair, self);
  requests->sendHello(ServiceCaller::returnToken(token_));
  {
    std::lock_guard<std::mutex> lock(mutex_);
    answers_ = std::move(ring);
    requests_ = std::move(requests);
  }
  runtime.addChannel(self);
}

void ServiceResponder::onPacket(const Packet& packet, SideChannel::Descriptors* descriptors)
{
  bool requests_end = false;
  bool answers_end = false;
  bool was_in_use = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (requests_ && packet.link == requests_->number())
    {
      requests_end = packet.type == Packet::ENDED;
      was_in_use = in_use_;
      if (packet.type == Packet::OFFER && !requests_->hasRing())
      {
        requests_end = !requests_->onOffer(packet, descriptors);
        if (!requests_end)
        {
          startRequests();
        }
      }
    }
    else if (answers_ && packet.link == (answers_->link() | Packet::TO_SENDER))
    {
      answers_proven_ |= answers_->isProof(packet);
      answers_end = !answers_->isProof(packet);
    }
  }
  if (requests_end)
  {
    closeRequests();
  }
  if (answers_end)
  {
    closeAnswers();  // the client reads no more answers
  }
  if (requests_end && was_in_use)
  {
    dropIfSilent(connection_.lock());
  }
}

void ServiceResponder::onPairEnded()
{
  bool was_in_use = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    was_in_use = in_use_;
  }
  closeRequests();
  closeAnswers();
  if (was_in_use)
  {
    dropIfSilent(connection_.lock());
  }
}

void ServiceResponder::startRequests()
{
  in_use_ = true;
  const ros::ServiceClientLinkPtr link = link_.lock();
  const ros::ServicePublicationPtr service = link ? link->parent_.lock() : nullptr;
  if (auto* queue = service ? dynamic_cast<ros::CallbackQueue*>(service->callback_queue_) : nullptr)
  {
    waiter_ = QueueWaiter::of(queue);
    requests_->ring().useDoorbell(waiter_->join());
  }
  RingReceiver::Message none;
  requests_->take(0, true, &none);  // arms the doorbell: no request comes before the proof
  requests_->sendProof();
}

void ServiceResponder::serve()
{
  for (;;)
  {
    RingReceiver::Message message;
    const Descriptor& descriptor = message.descriptor;
    boost::shared_array<uint8_t> body;
    bool in_turn = false;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (!in_use_)
      {
        return;
      }
      const RingReceiver::Take take = requests_->take(0, true, &message);
      if (take == RingReceiver::Take::WAITING || take == RingReceiver::Take::EMPTY)
      {
        return;
      }
      if (take == RingReceiver::Take::UNREADABLE)
      {
        requests_->decline();  // the client sends it over TCPROS
        break;
      }
      in_turn = pending_ == 0 && descriptor.serial != 0;
      body = in_turn && descriptor.segment != Descriptor::LINK_START ? fetchMessage(requests_, message, &copied_)
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
  closeRequests();
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
    if (answers_ && answers_proven_)
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
    requests->detach();
    in_use_ = false;
  }
  if (waiter)
  {
    waiter->leave();
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
    answers_->pair().removeSender(answers_->link(), this);
    answers_.reset();
  }
  runtime.removeChannel(self);
  runtime.announceRetired();
}

}  // namespace pi_os_transport
