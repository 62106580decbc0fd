#include "bridge/outgoing_link.h"

namespace pi_os_transport
{

void OutgoingLink::onPublisherWaits()
{
  publisher_waits_ = true;
  announceSpace();
}

void OutgoingLink::onProgress()
{
  progressed_ = true;
  announceSpace();
}

void OutgoingLink::announceSpace()
{
  if (publisher_waits_ && progressed_ && ring->hasRing() && ring->ring().available() < RingLayout::CAPACITY / 2)
  {
    publisher_waits_ = false;
    progressed_ = false;
    ring->channel().send(Packet::of(Packet::SPACE));
  }
}

}  // namespace pi_os_transport
