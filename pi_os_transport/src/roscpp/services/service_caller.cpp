#include "roscpp/services/service_caller.h"

#include <ros/console.h>

#include <cstring>
#include <utility>

#include "event_loop/if_alive.h"
#include "roscpp/services/tcp_calls.h"
#include "roscpp/topics/header_offer.h"
#include "roscpp/topics/receive_link.h"

namespace pi_os_transport
{

ServiceCaller::ServiceCaller(const std::string& service, const ros::ConnectionPtr& connection, Use use)
  : connection_(connection)
  , use_(use)
  , statistics_(Runtime::instance().called_services.of(service))
  , state_(use != Use::SINGLE_SHOT_PLAIN ? State::NEGOTIATING : State::REFUSED)
{
}

ServiceCaller::~ServiceCaller() = default;

bool ServiceCaller::promising() const
{
  const State state = state_;
  return state == State::READY || state == State::NEGOTIATING;
}

bool ServiceCaller::meet(const std::string& field)
{
  Runtime& runtime = Runtime::instance();
  const std::optional<HeaderOffer> offer = HeaderOffer::parse(field);
  Fallback reason = field.empty() ? Fallback::PEER_SILENT : Fallback::PEER_VERSION;
  const std::shared_ptr<ProcessPair> pair = offer ? runtime.pairWith(offer->socket, &reason) : nullptr;
  if (!pair)
  {
    fallback_ = reason;
    fail();
    return false;
  }
  const std::shared_ptr<ServiceCaller> self = shared_from_this();
  auto answers = std::make_shared<RingReceiver>(pair, self);
  return_token_ = returnToken(offer->link);
  runtime.expect(return_token_, ifAlive(self, [](const auto& expected, const std::shared_ptr<ProcessPair>& from,
                                                 const Packet& hello) { expected->onReturn(from, hello); }));
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (state_ != State::ENDED)
    {
      answers_ = answers;
    }
  }
  if (state_ == State::ENDED || !answers->sendHello(offer->link))
  {
    fail();
    return false;
  }
  return true;
}

/// The server asks for the ring of requests.
void ServiceCaller::onReturn(const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
{
  Runtime& runtime = Runtime::instance();
  runtime.forget(return_token_);
  const std::shared_ptr<ServiceCaller> self = shared_from_this();
  auto requests = std::make_unique<RingSender>(&runtime.pool(), runtime.leaseBudget());
  std::string error;
  if (state_ != State::NEGOTIATING || !pair->addSender(hello.link, self) || !requests->open(pair, hello.link, &error))
  {
    if (!error.empty())
    {
      fallback_ = Fallback::NO_MEMORY;
      runtime.warnOfShortage("no shared memory for a service: " + error);
    }
    pair->removeSender(hello.link, this);
    pair->send(Packet::ended(hello.link, LinkEnd::REFUSED));
    fail();
    return;
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    requests_ = std::move(requests);
  }
  runtime.addChannel(self);
}

void ServiceCaller::onPacket(const Packet& packet, SideChannel::Descriptors* descriptors)
{
  bool answers_end = false;
  bool requests_end = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (answers_ && packet.link == answers_->number())
    {
      answers_end = packet.type == Packet::ENDED;
      if (packet.type == Packet::OFFER && !answers_->hasRing())
      {
        answers_end = !answers_->onOffer(packet, descriptors);
        if (!answers_end)
        {
          answers_->ring().useDoorbell(WAITING_THREAD);
          answers_proven_ = answers_->sendProof();
          settle();
        }
      }
    }
    else if (requests_ && packet.link == (requests_->link() | Packet::TO_SENDER))
    {
      requests_proven_ |= requests_->isProof(packet);
      settle();
      requests_end = !requests_->isProof(packet);
      State ready = State::READY;
      if (packet.type == Packet::DECLINED && state_.compare_exchange_strong(ready, State::REFUSED))
      {
        fallback_ = Fallback::NO_MEMORY;
        takeBackRequest();
      }
    }
  }
  if (answers_end || requests_end)
  {
    fail();
  }
  if (requests_end)
  {
    closeRequests();  // the server reads no more requests
  }
}

void ServiceCaller::onPairEnded()
{
  fail();
  closeRequests();
}

/// The memory of an answer has come.
void ServiceCaller::serve()
{
  std::lock_guard<std::mutex> lock(mutex_);
  ++served_;
  changed_.notify_all();
}

/// Lets the calls that wait look again. state_ has changed.
void ServiceCaller::wakeCalls()
{
  std::lock_guard<std::mutex> lock(mutex_);
  changed_.notify_all();
  if (answers_ && answers_->hasRing())
  {
    answers_->disturb();
  }
}

/// Call with mutex_ held.
void ServiceCaller::settle()
{
  State negotiating = State::NEGOTIATING;
  if (requests_proven_ && answers_proven_ && state_.compare_exchange_strong(negotiating, State::READY))
  {
    changed_.notify_all();
  }
}

void ServiceCaller::fail()
{
  State expected = State::NEGOTIATING;
  const bool refused = state_.compare_exchange_strong(expected, State::REFUSED);
  Fallback unexplained = Fallback::NEGOTIATING;
  fallback_.compare_exchange_strong(unexplained, Fallback::BROKEN);
  const bool ended = expected == State::READY && state_.compare_exchange_strong(expected, State::ENDED);
  Runtime::instance().forget(return_token_);
  wakeCalls();
  leaveAnswers();
  if (!refused && ended)
  {
    dropIfSilent(connection_.lock());
  }
}

void ServiceCaller::disconnect()
{
  state_ = State::ENDED;
  Runtime::instance().forget(return_token_);
  wakeCalls();
  leaveAnswers();
}

void ServiceCaller::leaveAnswers()
{
  // A call or lease that still reads keeps the receiver. Its end tells the server to free the memory.
  std::shared_ptr<RingReceiver> answers;
  std::lock_guard<std::mutex> lock(mutex_);
  answers = std::exchange(answers_, nullptr);
  if (answers)
  {
    answers->detach();
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
    requests_->pair().removeSender(requests_->link(), this);
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

}  // namespace pi_os_transport
