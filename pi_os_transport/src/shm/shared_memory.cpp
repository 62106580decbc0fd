#include "shm/shared_memory.h"

#include <fcntl.h>
#include <linux/memfd.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace pi_os_transport
{
namespace
{

std::string describeLimit(int resource)
{
  rlimit limit{};
  return getrlimit(static_cast<__rlimit_resource>(resource), &limit) != 0 || limit.rlim_cur == RLIM_INFINITY
             ? "unlimited"
             : std::to_string(limit.rlim_cur);
}

}  // namespace

std::string describeShortage(int error)
{
  const std::string files = describeLimit(RLIMIT_NOFILE) + " open files (ulimit -n)";
  switch (error)
  {
    case EMFILE:
    case ETOOMANYREFS:
      return "this process has reached its limit of " + files;
    case ENFILE:
      return "this computer has reached its limit of open files (/proc/sys/fs/file-max)";
    case ENOMEM:
      return "this process has reached its limit of address space (ulimit -v), " + describeLimit(RLIMIT_AS) +
             " bytes, or of mappings (/proc/sys/vm/max_map_count); it may have " + files;
    default:
      return "";
  }
}

std::string describeFailure(const char* what, uint64_t bytes)
{
  const int error = errno;
  const std::string shortage = describeShortage(error);
  return std::string(what) + " of " + std::to_string(bytes) + " bytes failed: " + std::strerror(error) +
         (shortage.empty() ? "" : "; " + shortage);
}

FileDescriptor makeSharedMemory(const char* name, uint64_t length, std::string* error)
{
#ifdef MFD_NOEXEC_SEAL
  constexpr unsigned NO_EXEC = MFD_NOEXEC_SEAL;
#else
  constexpr unsigned NO_EXEC = 8U;
#endif
  rlimit file_size{};
  if (getrlimit(RLIMIT_FSIZE, &file_size) == 0 && length > file_size.rlim_cur)
  {
    // Checked here because exceeding the limit also raises SIGXFSZ.
    *error = "shared memory of " + std::to_string(length) + " bytes exceeds the file size limit of this process (" +
             std::to_string(file_size.rlim_cur) + ", see ulimit -f)";
    return FileDescriptor();
  }
  constexpr unsigned FLAGS = MFD_CLOEXEC | MFD_ALLOW_SEALING;
  int fd = static_cast<int>(syscall(SYS_memfd_create, name, FLAGS | NO_EXEC));
  if (fd < 0 && errno == EINVAL)  // kernels before 6.3 do not know the flag
  {
    fd = static_cast<int>(syscall(SYS_memfd_create, name, FLAGS));
  }
  if (fd < 0)
  {
    *error = describeFailure("memfd_create for shared memory", length);
    return FileDescriptor();
  }
  FileDescriptor memory(fd);
  // Unlike ftruncate(), allocates the pages now: a lack of memory is an error here instead of SIGBUS in a reader.
  if (TEMP_FAILURE_RETRY(fallocate(fd, 0, 0, static_cast<off_t>(length))) != 0)
  {
    *error = describeFailure("allocation of shared memory", length);
    return FileDescriptor();
  }
  return memory;
}

void sealSharedMemory(int fd, bool future_writes)
{
#ifndef F_SEAL_FUTURE_WRITE
  constexpr int F_SEAL_FUTURE_WRITE = 0x0010;
#endif
  constexpr int SIZE_SEALS = F_SEAL_SHRINK | F_SEAL_GROW;
  if (!future_writes || fcntl(fd, F_ADD_SEALS, SIZE_SEALS | F_SEAL_FUTURE_WRITE) != 0)
  {
    fcntl(fd, F_ADD_SEALS, SIZE_SEALS);  // before Linux 5.1, readers are trusted to map read-only
  }
}

bool isSealed(int fd, uint64_t length)
{
  struct stat status;
  const int seals = fcntl(fd, F_GET_SEALS);
  return seals >= 0 && (seals & F_SEAL_SHRINK) != 0 && fstat(fd, &status) == 0 &&
         static_cast<uint64_t>(status.st_size) >= length;
}

SharedMapping::SharedMapping(int fd, size_t length, bool writable)
{
  void* address =
      mmap(nullptr, length, writable ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED | MAP_POPULATE, fd, 0);
  if (address != MAP_FAILED)
  {
    madvise(address, length, MADV_DONTFORK);
    data_ = static_cast<uint8_t*>(address);
    length_ = length;
  }
}

SharedMapping& SharedMapping::operator=(SharedMapping&& other) noexcept
{
  if (this != &other)
  {
    reset();
    data_ = std::exchange(other.data_, nullptr);
    length_ = std::exchange(other.length_, 0);
  }
  return *this;
}

void SharedMapping::reset()
{
  if (data_ != nullptr && !isForkedChild())  // a child may have mapped other memory there
  {
    munmap(data_, length_);
  }
  data_ = nullptr;
}

}  // namespace pi_os_transport
