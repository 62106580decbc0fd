#pragma once

#include <cstddef>
#include <memory>
#include <mutex>

namespace pi_runtime
{

/// Counts memory that is held on behalf of others, up to a limit. Thread safe.
class MemoryBudget
{
public:
  explicit MemoryBudget(size_t limit_bytes);

  /// @return counts the bytes for as long as it lives, which may be longer than the budget; null if there is no room.
  std::shared_ptr<const void> take(size_t bytes);

  size_t used() const;
  size_t limit() const { return limit_; }

private:
  struct State
  {
    std::mutex mutex;
    size_t used = 0;
  };
  const size_t limit_;
  const std::shared_ptr<State> state_;
};

}  // namespace pi_runtime
