#include <pi_runtime/buffer.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>

namespace pi_runtime
{
namespace
{

constexpr size_t PAGE_BYTES = 4096;

}  // namespace

Buffer::Buffer(void* data, size_t bytes, bool read_only, std::shared_ptr<const void> owner)
  : data_(data), bytes_(bytes), read_only_(read_only), owner_(std::move(owner))
{
}

// The copies go before the memory that they may refer to.
Buffer::~Buffer()
{
  views_.clear();
  entries_.clear();
}

BufferPtr Buffer::allocate(size_t bytes)
{
  if (bytes == 0)
  {
    throw std::invalid_argument("Buffer::allocate: bytes = 0, must be at least 1");
  }
  const size_t rounded = (bytes + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
  void* data = rounded < bytes ? nullptr : std::aligned_alloc(PAGE_BYTES, rounded);
  if (data == nullptr)
  {
    throw std::bad_alloc();
  }
  const std::shared_ptr<void> owner(data, std::free);
  std::memset(data, 0, rounded);
  return BufferPtr(new Buffer(data, bytes, false, owner));
}

BufferPtr Buffer::wrap(void* data, size_t bytes, std::shared_ptr<const void> owner)
{
  if (data == nullptr || bytes == 0)
  {
    throw std::invalid_argument("Buffer::wrap: needs memory of at least one byte");
  }
  return BufferPtr(new Buffer(data, bytes, false, std::move(owner)));
}

BufferPtr Buffer::wrap(const void* data, size_t bytes, std::shared_ptr<const void> owner)
{
  if (data == nullptr || bytes == 0)
  {
    throw std::invalid_argument("Buffer::wrap: needs memory of at least one byte");
  }
  return BufferPtr(new Buffer(const_cast<void*>(data), bytes, true, std::move(owner)));
}

void* Buffer::host(Access access)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (reads(access))
  {
    bringToHost();
  }
  for (const Entry& entry : entries_)
  {
    if (entry.copy)
    {
      entry.space->giveToHost(*entry.copy, bytes_);
    }
  }
  if (writes(access) && !entries_.empty())
  {
    setValid(true, nullptr, false);
  }
  return data_;
}

size_t Buffer::bytesToMove(const MemorySpace* space, Access access) const
{
  if (!reads(access))
  {
    return 0;
  }
  std::lock_guard<std::mutex> lock(state_mutex_);
  if (space == nullptr)
  {
    return host_valid_ ? 0 : bytes_;
  }
  for (const Entry& entry : entries_)
  {
    if (entry.space.get() == space && entry.valid)
    {
      return 0;
    }
  }
  return host_valid_ ? bytes_ : 2 * bytes_;
}

Buffer::Entry& Buffer::entryOf(const std::shared_ptr<MemorySpace>& space)
{
  for (Entry& entry : entries_)
  {
    if (entry.space == space)
    {
      return entry;
    }
  }
  std::lock_guard<std::mutex> lock(state_mutex_);
  entries_.push_back(Entry{space, nullptr});
  return entries_.back();
}

/// @param entry  becomes valid, if there is one. @param others  whether copies elsewhere stay valid.
void Buffer::setValid(bool host, Entry* entry, bool others)
{
  std::lock_guard<std::mutex> lock(state_mutex_);
  host_valid_ = host;
  for (Entry& other : entries_)
  {
    other.valid = &other == entry || (others && other.valid);
  }
}

size_t Buffer::bringToHost()
{
  if (host_valid_)
  {
    return 0;
  }
  const auto newest = std::find_if(entries_.begin(), entries_.end(), [](const Entry& entry) { return entry.valid; });
  try
  {
    newest->space->download(*newest->copy, data_, bytes_);
  }
  catch (const std::exception& error)
  {
    // No OpenClError: the unit that asks for the content is not the broken one.
    throw std::runtime_error("the newest content of a buffer of " + std::to_string(bytes_) +
                             " bytes cannot be had from the unit that wrote it: " + error.what());
  }
  setValid(true, nullptr, true);
  return bytes_;
}

size_t Buffer::bringTo(Entry& entry, Access access)
{
  size_t moved = 0;
  if (reads(access) && !entry.valid)
  {
    moved += bringToHost();
    entry.space->upload(*entry.copy, data_, bytes_);
    moved += bytes_;
  }
  setValid(host_valid_ && !writes(access), &entry, !writes(access));
  return moved;
}

}  // namespace pi_runtime
