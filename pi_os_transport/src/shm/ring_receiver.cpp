#include "shm/ring_receiver.h"

#include <cerrno>

#include "shm/futex.h"

#include "shm/step_mark.h"

namespace pi_os_transport
{

void RingReceiver::leave()
{
  if (number_ != 0 && !std::exchange(left_, true) && !isForkedChild())
  {
    pair_->leave(number_);
  }
}

bool RingReceiver::sendHello(const Token& token, uint64_t mark)
{
  return number_ != 0 && pair_->send(Packet::of(Packet::HELLO, number_, token.high, token.low, mark));
}

bool RingReceiver::onOffer(const Packet& offer, SideChannel::Descriptors* descriptors)
{
  const int memory = descriptors->front().get();
  errno = 0;
  memory_ = isSealed(memory, sizeof(RingLayout)) ? SharedMapping(memory, sizeof(RingLayout), true) : SharedMapping();
  if (!memory_ || layout()->magic != RingLayout::MAGIC)
  {
    return false;
  }
  ring_ = std::make_unique<RingConsumer>(layout());
  nonce_ = layout()->nonce;
  lease_budget_ = offer.values[0];
  PI_OS_STEP("accept.mapped");
  return true;
}

bool RingReceiver::sendProof()
{
  const bool sent = pair_->send(Packet::of(Packet::PROOF, number_ | Packet::TO_SENDER, nonce_));
  PI_OS_STEP("accept.proved");
  return sent;
}

void RingReceiver::decline()
{
  tell(Packet::DECLINED);
}

RingReceiver::Take RingReceiver::take(uint32_t tcp_delivered, bool in_any_order, Message* message)
{
  Descriptor* const descriptor = &message->descriptor;
  uint32_t index = 0;
  while (ring_->peek(descriptor, &index))
  {
    if (!in_any_order && static_cast<int32_t>(descriptor->after_tcp - tcp_delivered) > 0)
    {
      return Take::WAITING;
    }
    message->segment.reset();
    const Take found =
        descriptor->segment != Descriptor::LINK_START ? find(*descriptor, &message->segment) : Take::TAKEN;
    if (found != Take::TAKEN)
    {
      return found;
    }
    const int ticket = ring_->takePeeked(index);
    if (ticket >= 0)
    {
      message->ticket = static_cast<uint32_t>(ticket);
      return Take::TAKEN;
    }
  }
  return Take::EMPTY;
}

void RingReceiver::sleep()
{
  futexWait(&layout()->armed, WAITING_THREAD, std::chrono::nanoseconds(-1));
}

void RingReceiver::disturb()
{
  layout()->armed.store(0, std::memory_order_seq_cst);
  futexWake(&layout()->armed);
}

RingReceiver::Take RingReceiver::find(const Descriptor& descriptor, std::shared_ptr<MappedSegment>* segment)
{
  const ProcessPair::Lookup lookup = pair_->findSegment(descriptor.segment, number_, segment);
  if (lookup != ProcessPair::Lookup::FOUND && !pair_->ended())
  {
    return lookup == ProcessPair::Lookup::LOST ? Take::UNREADABLE : Take::WAITING;
  }
  if (*segment && descriptor.offset + descriptor.length > (*segment)->length())
  {
    segment->reset();
  }
  return Take::TAKEN;
}

void RingReceiver::lease(uint32_t length)
{
  leased_bytes_ += length;
  ++leases_;
}

void RingReceiver::endLease(uint32_t ticket, uint32_t length)
{
  leased_bytes_ -= length;
  --leases_;
  release(ticket);
}

}  // namespace pi_os_transport
