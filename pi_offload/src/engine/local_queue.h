#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

namespace pi_offload
{

/// Pictures that wait for the vehicle's own detector, which gets one at a time: it cannot drop a picture that waits
/// here. Not thread safe.
class LocalQueue
{
public:
  struct Entry
  {
    uint64_t task = 0;
    int64_t stamp_ns = 0;     ///< of the picture; the answer carries it
    int64_t deadline_ns = 0;  ///< by the monotonic clock
  };

  /// @param max_waiting  at least 1. @param lost_s  longest wait for the detector's answer [s].
  LocalQueue(size_t max_waiting, double lost_s);

  /// @return the oldest picture if too many wait; it is dropped.
  std::optional<Entry> add(const Entry& entry);

  /// The picture for the detector now; nullopt: none waits, or the detector is at work.
  /// @param[out] dropped  pictures that would be late while a later one waits, and one that was not answered.
  /// @param local_s  time of the detector for a picture [s].
  std::optional<Entry> next(int64_t now_ns, double local_s, std::vector<Entry>* dropped);

  struct Answer
  {
    bool expected = false;
    uint64_t task = 0;
    double work_s = 0.0;   ///< since the detector got the picture
    bool skipped = false;  ///< the detector answered a later picture; `task` gets no answer
  };
  /// The detector answered. `expected` is false if no answer was awaited, or if it is for an earlier picture.
  Answer answered(int64_t stamp_ns, int64_t now_ns);

  /// Forgets a picture that waits. @return false if it does not wait, also if the detector works on it.
  bool forget(uint64_t task);
  /// The picture at work is given up. @return false if this task is not at work.
  bool giveUp(uint64_t task);

  /// Gives up all pictures and returns them.
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
