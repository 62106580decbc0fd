#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Makes anonymous shared memory of `length` bytes with all its pages allocated.
/// @return an empty descriptor on failure, with `*error` set.
FileDescriptor makeSharedMemory(const char* name, uint64_t length, std::string* error);

/// Forbids changes of the length and, if `future_writes` and the kernel allow, new writable mappings.
void sealSharedMemory(int fd, bool future_writes);

/// "<what> of <bytes> bytes failed: <errno as text>" and the limit that was reached, for error messages.
std::string describeFailure(const char* what, uint64_t bytes);

/// The limits of this process that `error`, a value of errno, comes from, with their values and names for ulimit. Empty
/// if it comes from none.
std::string describeShortage(int error);

/// True if `fd` is memory of at least `length` bytes that cannot shrink.
bool isSealed(int fd, uint64_t length);

/// A mapping of shared memory. Unmapped by the destructor, and absent in forked children.
class SharedMapping
{
public:
  SharedMapping() = default;
  /// Maps all of `fd`. Empty on failure, with errno set.
  SharedMapping(int fd, size_t length, bool writable);
  ~SharedMapping() { reset(); }
  SharedMapping(SharedMapping&& other) noexcept { *this = static_cast<SharedMapping&&>(other); }
  SharedMapping& operator=(SharedMapping&& other) noexcept;
  SharedMapping(const SharedMapping&) = delete;
  SharedMapping& operator=(const SharedMapping&) = delete;

  uint8_t* data() const { return data_; }
  explicit operator bool() const { return data_ != nullptr; }
  void reset();

private:
  uint8_t* data_ = nullptr;
  size_t length_ = 0;
};

}  // namespace pi_os_transport
