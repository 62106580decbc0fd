#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

namespace pi_offload
{

/// Pictures on their way to the vehicle's own detector, one at a time: what it has not been given yet it cannot drop.
/// Not thread safe.
class LocalQueue
{
public:
  struct Entry
  {
    uint64_t task = 0;
    int64_t stamp_ns = 0;     ///< of the picture; the answer carries it
    int64_t deadline_ns = 0;  ///< by the monotonic clock
  };

  /// @param max_waiting  at least 1. @param lost_s  after which no answer comes any more [s].
  LocalQueue(size_t max_waiting, double lost_s);

  /// @return the oldest, where too many wait: it is dropped.
  std::optional<Entry> add(const Entry& entry);

  /// The picture to be given to the detector now; nullopt: none waits, or the detector is at work.
  /// Dropped is what would come too late, if a later one waits, and what was not answered for too long.
  /// @param local_s  that the detector needs [s].
  std::optional<Entry> next(int64_t now_ns, double local_s, std::vector<Entry>* dropped);

  struct Answer
  {
    bool expected = false;
    uint64_t task = 0;
    double work_s = 0.0;   ///< from when it was given to the detector on
    bool skipped = false;  ///< the detector answered a later picture in place of this one: `task` gets no answer
  };
  /// The detector answered. Not expected is an answer while none is awaited, or of an earlier picture.
  Answer answered(int64_t stamp_ns, int64_t now_ns);

  /// The task has ended otherwise. @return true if it waited; what is at work stays at work.
  bool forget(uint64_t task);
  /// The picture at work is given up. @return false if this task is not at work.
  bool giveUp(uint64_t task);

  /// All are given up. @return them.
  std::vector<Entry> clear();

  size_t waiting() const { return waiting_.size(); }
  bool busy() const { return working_.has_value(); }
  /// Since the picture at work was given to the detector [s]; 0: none.
  double workingFor(int64_t now_ns) const;

private:
  const size_t max_waiting_;
  const double lost_s_;
  std::deque<Entry> waiting_;
  std::optional<Entry> working_;
  int64_t began_ns_ = 0;
};

}  // namespace pi_offload
