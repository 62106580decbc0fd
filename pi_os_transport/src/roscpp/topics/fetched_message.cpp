#include "roscpp/topics/fetched_message.h"

#include <cerrno>
#include <string>

#include "roscpp/held_leases.h"
#include "roscpp/runtime.h"
#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

/// Most leased messages; further ones are copied. The ring has tickets for twice as many.
constexpr uint32_t MAX_LEASES = RingLayout::CAPACITY / 2;

/// Deleter of a leased buffer: returns it to the publisher.
struct Lease
{
  std::shared_ptr<RingReceiver> ring;
  std::shared_ptr<MappedSegment> segment;
  uint32_t ticket;
  uint32_t length;

  void operator()(uint8_t*) const
  {
    if (Runtime::instance().active())
    {
      ring->endLease(ticket, length);
    }
  }
};

/// A message for roscpp. @param end  called after the last user. @param held  counts held messages; null: the message
/// cannot be held.
template <typename End>
boost::shared_array<uint8_t> makeHoldable(uint8_t* message, const End& end,
                                          const std::shared_ptr<std::atomic<uint64_t>>& held)
{
  if (!held || !HeldLeases::instance().wanted())
  {
    return boost::shared_array<uint8_t>(message, end);
  }
  std::shared_ptr<HeldLease> lease = HeldLeases::instance().add(
      message, [end, message]() { end(message); }, held);
  return boost::shared_array<uint8_t>(message, [lease](uint8_t*) mutable { lease.reset(); });
}

}  // namespace

boost::shared_array<uint8_t> fetchMessage(const std::shared_ptr<RingReceiver>& ring,
                                          const RingReceiver::Message& message, uint64_t* copied,
                                          const std::shared_ptr<std::atomic<uint64_t>>& held)
{
  const std::shared_ptr<MappedSegment>& segment = message.segment;
  const Descriptor& descriptor = message.descriptor;
  if (!segment)
  {
    ring->release(message.ticket);
    return boost::shared_array<uint8_t>();
  }
  if (segment->data() == nullptr)
  {
    Runtime::instance().warnOfShortage(
        "cannot map " + std::to_string(segment->length()) +
        " bytes of shared memory; its messages are copied out instead: " + describeShortage(ENOMEM));
  }
  else if (ring->leases() < MAX_LEASES &&
           (ring->leases() < 2 || ring->leasedBytes() + descriptor.length <= ring->leaseBudget()))
  {
    ring->lease(descriptor.length);
    return makeHoldable(const_cast<uint8_t*>(segment->data() + descriptor.offset),
                        Lease{ring, segment, message.ticket, descriptor.length}, held);
  }
  const boost::shared_array<uint8_t> copy = makeHoldable(
      new uint8_t[descriptor.length], [](uint8_t* bytes) { delete[] bytes; },
      held ? std::make_shared<std::atomic<uint64_t>>() : nullptr);
  const bool intact = segment->copy(descriptor.offset, copy.get(), descriptor.length);
  ring->release(message.ticket);
  ++*copied;
  return intact ? copy : boost::shared_array<uint8_t>();
}

}  // namespace pi_os_transport
