#pragma once

#include <cstddef>
#include <vector>

namespace pi_runtime
{

/// The free gaps of one computing unit from 0 s on, for the inner-core scheduler. A busy unit has far fewer gaps than
/// nodes.
class UnitTimeline
{
public:
  struct Gap
  {
    double begin;  // [s]
    double end;    // [s]
  };

  /// Time for one node inside a gap.
  struct Slot
  {
    double start;       // [s]
    double finish;      // [s]
    Gap gap;            // around it
    std::size_t index;  // of the gap
  };

  UnitTimeline() { clear(); }
  void clear();

  /// The first slot of `duration` that begins no earlier than `ready`.
  Slot firstSlot(double ready, double duration) const;

  /// The same after everything that is occupied.
  Slot lastSlot(double ready, double duration) const;

  /// @param slot  found since the last change.
  void occupy(const Slot& slot);

  /// Undoes occupy(); what was occupied after it must be released already.
  void release(const Slot& slot);

private:
  std::vector<Gap> gaps_;  // by rising time; the last one never ends
};

}  // namespace pi_runtime
