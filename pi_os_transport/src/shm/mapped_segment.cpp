#include "shm/mapped_segment.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace pi_os_transport
{

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

}  // namespace pi_os_transport
