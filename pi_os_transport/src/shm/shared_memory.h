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

/// Forbids changes of the length and, if `future_writes` and the kernel can, writable mappings made from now on.
void sealSharedMemory(int fd, bool future_writes);

/// "<what> of <bytes> bytes failed: <errno as text>", for error messages.
std::string describeFailure(const char* what, uint64_t bytes);

/// True if `fd` is memory of at least `length` bytes that nobody can shrink under a reader.
bool isSealed(int fd, uint64_t length);

/// Shared memory mapped at [address, address + length): unmapped when this ends, and absent in forked children, where
/// it would otherwise outlive its last user. Movable, not copyable.
class SharedMapping
{
public:
  SharedMapping() = default;
  /// Maps all of `fd` at an address of the kernel's choice. Empty on failure, with errno set.
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
