#pragma once

#include <cstdint>

#include "shm/file_descriptor.h"
#include "shm/shared_memory.h"

namespace pi_os_transport
{

/// A segment of a peer's pool, mapped read-only. Shared by all links with that peer, and by the messages being read.
class MappedSegment
{
public:
  /// Maps `memory`. If there is no address space, copy() reads through the descriptor.
  MappedSegment(FileDescriptor memory, uint64_t length);

  uint64_t length() const { return length_; }
  /// Null if it could not be mapped.
  const uint8_t* data() const { return mapping_.data(); }
  /// Copies [offset, offset + bytes) out. False on a read error.
  bool copy(uint64_t offset, uint8_t* out, uint32_t bytes) const;

private:
  SharedMapping mapping_;
  FileDescriptor memory_;  ///< only if it could not be mapped
  uint64_t length_;
};

}  // namespace pi_os_transport
