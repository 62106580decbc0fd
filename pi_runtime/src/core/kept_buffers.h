#pragma once

#include <cstddef>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include <pi_runtime/buffer.h>
#include "core/memory_budget.h"

namespace pi_runtime
{

/// Buffers under names, so that tasks of other processes can be chained without moving data out of this one.
/// Thread safe.
class KeptBuffers
{
public:
  /// @param limit_bytes  of all buffers together, those included that were dropped or replaced while tasks use them.
  explicit KeptBuffers(size_t limit_bytes) : budget_(limit_bytes) {}

  /// The buffers as they will be once a submission is accepted. One thread at a time; the buffers outlive it.
  class Draft
  {
  public:
    explicit Draft(KeptBuffers* buffers) : buffers_(buffers) {}

    /// @return null if there is none of this name, in the draft or before.
    BufferPtr find(const std::string& name) const;
    /// A new, zeroed buffer under this name; one that had it goes on for those who use it.
    /// @throws std::invalid_argument if bytes is 0; std::runtime_error if that is too much beside the others.
    BufferPtr make(const std::string& name, size_t bytes);
    /// Makes the new buffers known to all. Without it they are forgotten.
    void commit();

  private:
    KeptBuffers* const buffers_;
    std::map<std::string, BufferPtr> made_;
  };

  /// @return null if there is none of this name.
  BufferPtr find(const std::string& name) const;
  /// Forgets a buffer. @return false if there is none of this name.
  bool drop(const std::string& name);
  std::vector<std::string> names() const;
  /// Held by all of them, as the limit counts.
  size_t bytes() const { return budget_.used(); }

private:
  MemoryBudget budget_;
  mutable std::mutex mutex_;
  std::map<std::string, BufferPtr> buffers_;
};

}  // namespace pi_runtime
