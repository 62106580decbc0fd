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
  while (descriptor_ && written < content.size())
  {
    const ssize_t bytes = write(descriptor_.get(), content.data() + written, content.size() - written);
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
  if (!descriptor_ || written < content.size() || lseek(descriptor_.get(), 0, SEEK_SET) != 0)
  {
    throw std::runtime_error(std::string("no file in memory for a dictionary: ") + std::strerror(errno) +
                             "; free memory or file descriptors of this process");
  }
}

std::string MemoryFile::path() const
{
  return "/proc/self/fd/" + std::to_string(descriptor_.get());
}

}  // namespace pi_speech
