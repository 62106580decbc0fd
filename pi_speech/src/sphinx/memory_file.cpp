#include "sphinx/memory_file.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace pi_speech
{

MemoryFile::MemoryFile(const std::string& content) : descriptor_(memfd_create("pi_speech", MFD_CLOEXEC))
{
  size_t written = 0;
  while (descriptor_ != -1 && written < content.size())
  {
    const ssize_t bytes = write(descriptor_, content.data() + written, content.size() - written);
    if (bytes < 0 && errno == EINTR)
    {
      continue;
    }
    if (bytes <= 0)
    {
      break;
    }
    written += static_cast<size_t>(bytes);
  }
  if (descriptor_ == -1 || written < content.size() || lseek(descriptor_, 0, SEEK_SET) != 0)
  {
    const std::string reason = std::strerror(errno);
    if (descriptor_ != -1)
    {
      close(descriptor_);
    }
    throw std::runtime_error("no file in memory for a dictionary: " + reason +
                             "; free memory or file descriptors of this process");
  }
}

MemoryFile::~MemoryFile()
{
  close(descriptor_);
}

std::string MemoryFile::path() const
{
  return "/proc/self/fd/" + std::to_string(descriptor_);
}

}  // namespace pi_speech
