#include "shm/ring_receiver.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <iterator>
#include <mutex>
#include <utility>

#include "shm/step_mark.h"

namespace pi_os_transport
{
namespace
{

/// The mapped segments of this process: several links to one publisher map its memory once. The key is the inode,
/// because a hostile peer could claim the identifiers of another one.
class SegmentTable
{
public:
  static SegmentTable& instance()
  {
    static SegmentTable* table = new SegmentTable;  // leases may outlive static destruction
    return *table;
  }

  /// @return null if `memory` is not valid.
  std::shared_ptr<MappedSegment> map(FileDescriptor memory, uint64_t length)
  {
    struct stat file;
    if (fstat(memory.get(), &file) != 0)
    {
      return nullptr;
    }
    std::lock_guard<std::mutex> lock(mutex_);
    for (auto entry = segments_.begin(); entry != segments_.end();)
    {
      entry = entry->second.expired() ? segments_.erase(entry) : std::next(entry);
    }
    std::weak_ptr<MappedSegment>& known = segments_[std::make_pair(file.st_dev, file.st_ino)];
    std::shared_ptr<MappedSegment> segment = known.lock();
    if (!segment || segment->length() < length)
    {
      segment = std::make_shared<MappedSegment>(std::move(memory), length);
      known = segment;
    }
    return segment;
  }

private:
  std::mutex mutex_;
  std::map<std::pair<dev_t, ino_t>, std::weak_ptr<MappedSegment>> segments_;
};

}  // namespace

MappedSegment::MappedSegment(FileDescriptor memory, uint64_t length)
  : mapping_(memory.get(), length, false), length_(length)
{
  if (!mapping_)
  {
    memory_ = std::move(memory);
  }
}

bool MappedSegment::copy(uint64_t offset, uint8_t* out, uint32_t bytes) const
{
  if (bytes == 0)
  {
    return true;
  }
  if (mapping_)
  {
    std::memcpy(out, mapping_.data() + offset, bytes);
    return true;
  }
  for (uint32_t done = 0; done < bytes;)
  {
    const ssize_t count = pread(memory_.get(), out + done, bytes - done, static_cast<off_t>(offset + done));
    if (count <= 0 && errno != EINTR)
    {
      return false;
    }
    done += count > 0 ? static_cast<uint32_t>(count) : 0;
  }
  return true;
}

SideChannel::Receive RingReceiver::readPackets()
{
  for (;;)
  {
    Packet packet;
    SideChannel::Descriptors descriptors;
    const SideChannel::Receive result = channel_.receive(&packet, &descriptors);
    if (result != SideChannel::Receive::PACKET)
    {
      return result;
    }
    if (packet.type == Packet::OFFER && ring_ == nullptr)
    {
      onOffer(packet, std::move(descriptors));
    }
    else if (packet.type == Packet::SEGMENT && isSealed(descriptors[0].get(), packet.values[1]))
    {
      const uint32_t id = static_cast<uint32_t>(packet.values[0]);
      segments_[id] = SegmentTable::instance().map(std::move(descriptors[0]), packet.values[1]);
    }
    else if (packet.type == Packet::RETIRED)
    {
      segments_.erase(static_cast<uint32_t>(packet.values[0]));
    }
    else if (packet.type == Packet::ENDED)
    {
      ended_ = static_cast<LinkEnd>(packet.values[0]);
      return SideChannel::Receive::CLOSED;
    }
    else if (packet.type == Packet::WAITING)
    {
      publisher_waits_ = true;
    }
  }
}

void RingReceiver::onOffer(const Packet& packet, SideChannel::Descriptors descriptors)
{
  const FileDescriptor& memory = descriptors[0];
  if (!isSealed(memory.get(), sizeof(RingLayout)) || !descriptors[1] || !descriptors[2])
  {
    return;
  }
  memory_ = SharedMapping(memory.get(), sizeof(RingLayout), true);
  auto* const layout = reinterpret_cast<RingLayout*>(memory_.data());
  if (layout == nullptr || layout->magic != RingLayout::MAGIC)
  {
    return;  // without a proof, the publisher stays on TCPROS
  }
  ring_ = std::make_unique<RingConsumer>(layout);
  nonce_ = layout->nonce;
  lease_budget_ = packet.values[2];
  doorbells_ = {std::move(descriptors[1]), std::move(descriptors[2])};
  PI_OS_STEP("accept.mapped");
}

bool RingReceiver::sendProof()
{
  const bool sent = channel_.send(Packet::of(Packet::PROOF, nonce_));
  PI_OS_STEP("accept.proved");
  return sent;
}

std::shared_ptr<MappedSegment> RingReceiver::find(const Descriptor& descriptor)
{
  auto found = segments_.find(descriptor.segment);
  if (found == segments_.end())
  {
    readPackets();  // the memory of a segment is sent before its first message
    found = segments_.find(descriptor.segment);
  }
  if (found == segments_.end() || !found->second || descriptor.offset + descriptor.length > found->second->length())
  {
    return nullptr;
  }
  return found->second;
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
