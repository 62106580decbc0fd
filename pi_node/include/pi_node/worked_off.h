#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

namespace pi_node
{

/// How far the inputs of a worker are worked off that takes some and leaves others out, in the order of their stamps
/// [ns]. Not thread safe.
class WorkedOff
{
public:
  /// An input is taken to be worked on, instead of one that may have waited.
  void taken(int64_t stamp_ns)
  {
    taken_ns_ = stamp_ns;
    left_out_ns_ = 0;
  }

  /// An input is left out. @return up to where all is worked off; nullopt: one that was taken before is not.
  std::optional<int64_t> leftOut(int64_t stamp_ns)
  {
    left_out_ns_ = stamp_ns;
    return done_ns_ == taken_ns_ ? std::optional(stamp_ns) : std::nullopt;
  }

  /// An input is worked off. @return up to where all is.
  int64_t workedOff(int64_t stamp_ns)
  {
    done_ns_ = stamp_ns;
    return stamp_ns == taken_ns_ ? std::max(stamp_ns, left_out_ns_) : stamp_ns;
  }

private:
  int64_t taken_ns_ = 0;     ///< the newest
  int64_t done_ns_ = 0;      ///< the last
  int64_t left_out_ns_ = 0;  ///< after the newest that was taken
};

}  // namespace pi_node
