#include "core/memory_budget.h"

namespace pi_runtime
{

MemoryBudget::MemoryBudget(size_t limit_bytes) : limit_(limit_bytes), state_(std::make_shared<State>()) {}

std::shared_ptr<const void> MemoryBudget::take(size_t bytes)
{
  {
    std::lock_guard<std::mutex> lock(state_->mutex);
    if (bytes > limit_ - state_->used)
    {
      return nullptr;
    }
    state_->used += bytes;
  }
  return std::shared_ptr<const void>(state_.get(),
                                     [state = state_, bytes](const void*)
                                     {
                                       std::lock_guard<std::mutex> lock(state->mutex);
                                       state->used -= bytes;
                                     });
}

size_t MemoryBudget::used() const
{
  std::lock_guard<std::mutex> lock(state_->mutex);
  return state_->used;
}

}  // namespace pi_runtime
