#include "core/kept_buffers.h"

#include <stdexcept>
#include <utility>

namespace pi_runtime
{

BufferPtr KeptBuffers::Draft::find(const std::string& name) const
{
  const auto made = made_.find(name);
  return made != made_.end() ? made->second : buffers_->find(name);
}

BufferPtr KeptBuffers::Draft::make(const std::string& name, size_t bytes)
{
  if (bytes == 0)
  {
    throw std::invalid_argument("buffer \"" + name + "\" would have 0 bytes, must have at least 1");
  }
  MemoryBudget& budget = buffers_->budget_;
  std::shared_ptr<const void> share = budget.take(bytes);
  if (!share)
  {
    throw std::runtime_error("buffer \"" + name + "\" of " + std::to_string(bytes) + " bytes does not fit: " +
                             std::to_string(budget.used()) + " of " + std::to_string(budget.limit()) +
                             " bytes for kept buffers are in use (max_kept_buffer_mb); drop some");
  }
  BufferPtr buffer = Buffer::allocate(bytes);
  Buffer* const address = buffer.get();
  // The share goes with the last user of the buffer, not with its name.
  BufferPtr counted(address, [buffer = std::move(buffer), share = std::move(share)](Buffer*) {});
  made_[name] = counted;
  return counted;
}

void KeptBuffers::Draft::commit()
{
  std::lock_guard<std::mutex> lock(buffers_->mutex_);
  for (auto& [name, buffer] : made_)
  {
    buffers_->buffers_[name] = std::move(buffer);
  }
  made_.clear();
}

BufferPtr KeptBuffers::find(const std::string& name) const
{
  std::lock_guard<std::mutex> lock(mutex_);
  const auto found = buffers_.find(name);
  return found != buffers_.end() ? found->second : nullptr;
}

bool KeptBuffers::drop(const std::string& name)
{
  std::lock_guard<std::mutex> lock(mutex_);
  return buffers_.erase(name) > 0;
}

std::vector<std::string> KeptBuffers::names() const
{
  std::vector<std::string> result;
  std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [name, buffer] : buffers_)
  {
    result.push_back(name);
  }
  return result;
}

}  // namespace pi_runtime
