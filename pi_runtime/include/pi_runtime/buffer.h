#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

namespace pi_runtime
{

/// How a task or the host uses a buffer.
enum class Access : uint8_t
{
  READ,
  WRITE,  ///< overwritten as a whole: what was in it is not moved to the unit
  READ_WRITE,
};

inline bool reads(Access access)
{
  return access != Access::WRITE;
}
inline bool writes(Access access)
{
  return access != Access::READ;
}

/// Memory of a computing unit that is not the host's: one object per OpenCL device with its own memory.
class MemorySpace
{
public:
  virtual ~MemorySpace() = default;
  /// What one buffer has in this memory; released with the buffer.
  struct Copy
  {
    virtual ~Copy() = default;
  };
  /// Blocks until the whole copy has the host's bytes. @throws OpenClError
  virtual void upload(Copy& copy, const void* host, size_t bytes) = 0;
  /// Blocks until the host has the copy's bytes. @throws OpenClError
  virtual void download(Copy& copy, void* host, size_t bytes) = 0;
  /// Called before each use by a unit or by the host. For host memory that has one owner at a time (map and unmap).
  /// @throws OpenClError
  virtual void giveToUnit(Copy&) {}
  virtual void giveToHost(Copy&, size_t /*bytes*/) {}
};

class Buffer;
using BufferPtr = std::shared_ptr<Buffer>;

/// Host memory that tasks read and write. Units that share the host's memory use it in place. For other units the
/// runtime keeps copies, and moves bytes only when a task or host() needs them.
///
/// Thread safe. The caller must order a task that writes a buffer and other users of it (by waiting, or by edges of a
/// graph).
class Buffer
{
public:
  /// Zeroed memory of its own, aligned to a page. @throws std::invalid_argument if bytes is 0.
  static BufferPtr allocate(size_t bytes);
  /// Memory of the caller, used in place. An OpenCL driver may copy it if the address is not a multiple of 64.
  /// @param owner  keeps the memory alive; null: the caller does.
  static BufferPtr wrap(void* data, size_t bytes, std::shared_ptr<const void> owner = nullptr);
  /// Read-only memory of the caller; a task that writes it is refused.
  static BufferPtr wrap(const void* data, size_t bytes, std::shared_ptr<const void> owner = nullptr);

  ~Buffer();
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;

  size_t bytes() const { return bytes_; }
  bool readOnly() const { return read_only_; }

  /// The host's memory, with the newest content if `access` reads. If `access` writes, copies on devices become stale.
  /// Call again after each task that wrote the buffer. May wait for a transfer.
  /// @throws std::runtime_error if the unit with the newest content fails to return it.
  void* host(Access access);
  /// As host(), as T.
  template <typename T>
  T* hostAs(Access access)
  {
    return static_cast<T*>(host(access));
  }

  /// The host's memory without any transfer: to compare addresses, and for units that share it.
  void* address() const { return data_; }

  /// The copy in a memory space, up to date if `access` reads. If `access` writes, other copies become stale.
  /// @param make  called once per space to create the copy.
  /// @param[out] moved  bytes transferred by this call.
  template <typename Make>
  MemorySpace::Copy& copyIn(const std::shared_ptr<MemorySpace>& space, Access access, const Make& make, size_t* moved)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    Entry& entry = entryOf(space);
    if (!entry.copy)
    {
      entry.copy = make();
    }
    *moved += bringTo(entry, access);
    space->giveToUnit(*entry.copy);
    return *entry.copy;
  }

  /// Bytes that a use with this access would move to the space (null: to the host) now. Does not wait for transfers.
  size_t bytesToMove(const MemorySpace* space, Access access) const;

  /// The cl_mem of this buffer in one context whose units share the host's memory. Made once per key.
  template <typename Make>
  MemorySpace::Copy& shared(const void* key, const Make& make)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    for (const SharedView& view : views_)
    {
      if (view.key == key)
      {
        return *view.object;
      }
    }
    views_.push_back(SharedView{key, make()});
    return *views_.back().object;
  }

private:
  struct Entry
  {
    std::shared_ptr<MemorySpace> space;
    std::unique_ptr<MemorySpace::Copy> copy;
    bool valid = false;
  };
  struct SharedView
  {
    const void* key;
    std::unique_ptr<MemorySpace::Copy> object;
  };
  Buffer(void* data, size_t bytes, bool read_only, std::shared_ptr<const void> owner);
  Entry& entryOf(const std::shared_ptr<MemorySpace>& space);
  size_t bringTo(Entry& entry, Access access);
  size_t bringToHost();
  void setValid(bool host, Entry* entry, bool others);

  void* const data_;
  const size_t bytes_;
  const bool read_only_;
  const std::shared_ptr<const void> owner_;
  std::mutex mutex_;                ///< held during transfers; guards all that follows
  mutable std::mutex state_mutex_;  ///< taken after mutex_ to change host_valid_ and entries_; to read, one of both
  bool host_valid_ = true;
  std::vector<Entry> entries_;
  std::vector<SharedView> views_;
};

}  // namespace pi_runtime
