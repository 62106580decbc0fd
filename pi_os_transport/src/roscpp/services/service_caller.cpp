#include "roscpp/services/service_caller.h"

#include <poll.h>
#include <ros/console.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "roscpp/services/tcp_calls.h"
#include "roscpp/topics/header_offer.h"
#include "roscpp/topics/receive_link.h"
#include "shm/event.h"

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

ServiceCaller::ServiceCaller(const std::string& service, const ros::ConnectionPtr& connection, Use use)
  : connection_(connection)
  , use_(use)
  , statistics_(Runtime::instance().called_services.of(service))
  , wake_(makeEvent())
  , state_(wake_ && use != Use::SINGLE_SHOT_PLAIN ? State::NEGOTIATING : State::REFUSED)
{
}

ServiceCaller::~ServiceCaller() = default;

bool ServiceCaller::promising() const
{
  const State state = state_;
  return state == State::READY || state == State::NEGOTIATING;
}

void ServiceCaller::awaitWake(int doorbell)
{
  std::array<pollfd, 2> waits{pollfd{wake_.get(), POLLIN, 0}, pollfd{doorbell, POLLIN, 0}};
  poll(waits.data(), doorbell >= 0 ? 2 : 1, -1);
  for (const pollfd& wait : waits)
  {
    if (wait.revents != 0)
    {
      clearEvent(wait.fd);
    }
  }
}

bool ServiceCaller::meet(const std::string& field)
{
  Runtime& runtime = Runtime::instance();
  const std::optional<HeaderOffer> offer = HeaderOffer::parse(field);
  SideChannel answers = offer && wake_ ? SideChannel::connect(HeaderOffer::socketName(offer->socket)) : SideChannel();
  if (!answers)
  {
    fallback_ = field.empty()    ? Fallback::PEER_SILENT
                : !offer         ? Fallback::PEER_VERSION
                : !wake_         ? Fallback::NO_MEMORY
                : errno == EPERM ? Fallback::OTHER_USER
                                 : Fallback::UNREACHABLE;
  }
  std::array<int, 2> ends{-1, -1};
  if (!answers || socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends.data()) != 0)
  {
    fail();
    return false;
  }
  SideChannel mine{FileDescriptor(ends[0])};
  const FileDescriptor theirs(ends[1]);
  auto requests = std::make_unique<RingSender>(&runtime.pool(), runtime.poolToken(), runtime.leaseBudget());
  std::string error;
  if (!answers.send(offer->hello(), {theirs.get()}) || !requests->open(std::move(mine), &error))
  {
    if (!error.empty())
    {
      fallback_ = Fallback::NO_MEMORY;
      ROS_WARN("pi_os_transport: no shared memory for a service (%s); its calls stay on TCPROS", error.c_str());
    }
    fail();
    return false;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  if (state_ == State::ENDED)
  {
    return false;
  }
  requests_ = std::move(requests);
  answers_ = std::make_shared<RingReceiver>(std::move(answers));
  const std::shared_ptr<ServiceCaller> self = shared_from_this();
  runtime.addChannel(self);
  runtime.watch(requests_->channel().fd(), [self](int) { self->onRequestChannel(); });
  runtime.watch(answers_->fd(), [self](int) { self->onAnswerChannel(); });
  return true;
}

void ServiceCaller::onAnswerChannel()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!answers_)
    {
      return;
    }
    const SideChannel::Receive received = answers_->readPackets();
    if (answers_->hasRing() && !std::exchange(answers_proven_, true))
    {
      answers_->sendProof();
      settle();
    }
    if (received == SideChannel::Receive::NOTHING)
    {
      return;
    }
  }
  fail();
}

void ServiceCaller::onRequestChannel()
{
  for (;;)
  {
    Packet packet;
    SideChannel::Descriptors descriptors;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (!requests_)
      {
        return;
      }
      const SideChannel::Receive received = requests_->channel().receive(&packet, &descriptors);
      if (received == SideChannel::Receive::NOTHING)
      {
        return;
      }
      if (received == SideChannel::Receive::PACKET)
      {
        requests_proven_ |= requests_->isProof(packet);
        settle();
        continue;
      }
    }
    fail();
    closeRequests();  // the server reads no more requests
    return;
  }
}

void ServiceCaller::settle()
{
  State negotiating = State::NEGOTIATING;
  if (requests_proven_ && answers_proven_ && state_.compare_exchange_strong(negotiating, State::READY))
  {
    signalEvent(wake_.get());
  }
}

void ServiceCaller::fail()
{
  State expected = State::NEGOTIATING;
  const bool refused = state_.compare_exchange_strong(expected, State::REFUSED);
  Fallback unexplained = Fallback::NEGOTIATING;
  fallback_.compare_exchange_strong(unexplained, Fallback::BROKEN);
  const bool ended = expected == State::READY && state_.compare_exchange_strong(expected, State::ENDED);
  leaveAnswers();
  signalEvent(wake_.get());
  if (!refused && ended)
  {
    dropIfSilent(connection_.lock());
  }
}

void ServiceCaller::disconnect()
{
  state_ = State::ENDED;
  leaveAnswers();
  signalEvent(wake_.get());
}

void ServiceCaller::leaveAnswers()
{
  // A call or lease that still reads keeps the receiver. Its end tells the server to free the memory.
  std::shared_ptr<RingReceiver> answers;
  std::lock_guard<std::mutex> lock(mutex_);
  answers = std::exchange(answers_, nullptr);
  if (answers)
  {
    Runtime::instance().unwatch(answers->fd());
  }
}

void ServiceCaller::closeRequests()
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<ServiceCaller> self = shared_from_this();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!requests_)
    {
      return;
    }
    runtime.unwatch(requests_->channel().fd());
    takeBackRequest();
    requests_.reset();
  }
  runtime.removeChannel(self);
  runtime.announceRetired();
}

/// Call with mutex_ held.
void ServiceCaller::takeBackRequest()
{
  for (const RingSender::Message& message : requests_->takeBack())
  {
    Runtime::instance().pool().release(message.buffer);
    taken_back_ = true;
  }
}

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
  while (request.num_bytes >= WORTH_WAITING && state_ == State::NEGOTIATING)
  {
    awaitWake(-1);
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
    Descriptor descriptor;
    uint32_t ticket = 0;
    RingConsumer::Take take = RingConsumer::Take::EMPTY;
    boost::shared_array<uint8_t> body;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      take = answers->ring().take(0, true, &descriptor, &ticket);
      if (take == RingConsumer::Take::TAKEN && descriptor.segment == Descriptor::LINK_START)
      {
        answers->release(ticket);
      }
      else if (take == RingConsumer::Take::TAKEN)
      {
        body = ReceiveLink::fetch(answers, descriptor, ticket, &copied_);
      }
    }
    if (take != RingConsumer::Take::TAKEN)
    {
      if (last_look)
      {
        return giveUp(link);
      }
      awaitWake(answers->doorbell(NETWORK_THREAD));
      continue;
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
  if (const ros::ConnectionPtr connection = connection_.lock())
  {
    connection->drop(ros::Connection::TransportDisconnect);
  }
  endCalls(link);  // makes the client's handle invalid
  return taken_back ? Outcome::NOT_TAKEN : Outcome::FAILURE;
}

}  // namespace pi_os_transport
