#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

namespace pi_os_transport
{

/// Maps the stamps of a recording that is played to stamps of now. The topics of one recording may arrive in any order
/// among each other. Not thread safe.
class StampMap
{
public:
  /// @param at_handover  the stamp of a message is the moment of its hand-over, one for all that was recorded at the
  /// same time. Else stamps keep their recorded distances, and the first of each lap is moved to now.
  explicit StampMap(bool at_handover) : at_handover_(at_handover) {}

  /// @return the new stamp [ns]. A recorded stamp that lies half a lap, and MIN_LAP_NS, back begins a new lap.
  int64_t stampOf(int64_t recorded_ns, int64_t now_ns)
  {
    const int64_t half_ns = std::max(last_lap_ns_, latest_ns_ - first_ns_) / 2 + MIN_LAP_NS;
    if (latest_ns_ < 0 || recorded_ns < latest_ns_ - half_ns)
    {
      last_lap_ns_ = latest_ns_ < 0 ? 0 : latest_ns_ - first_ns_;
      last_offset_ns_ = std::exchange(offset_ns_, now_ns - recorded_ns);
      first_ns_ = latest_ns_ = recorded_ns;
      handovers_.clear();
    }
    const bool of_last_lap = last_lap_ns_ > 0 && recorded_ns > latest_ns_ + half_ns;
    latest_ns_ = of_last_lap ? latest_ns_ : std::max(latest_ns_, recorded_ns);
    const int64_t stamp_ns = recorded_ns + (of_last_lap ? last_offset_ns_ : offset_ns_);
    lateness_ns_ = std::max<int64_t>(0, now_ns - stamp_ns);
    if (!at_handover_)
    {
      return stamp_ns;
    }
    const int64_t handover_ns = handovers_.emplace(recorded_ns, now_ns).first->second;
    if (handovers_.size() > REMEMBERED)
    {
      handovers_.erase(handovers_.begin());
    }
    return handover_ns;
  }

  /// How far the last message was behind the first one of its lap, at true rate [ns].
  int64_t latenessNs() const { return lateness_ns_; }

  static constexpr int64_t MIN_LAP_NS = 100000000;
  static constexpr size_t REMEMBERED = 1000;  ///< stamps, for what was recorded together and comes later

private:
  const bool at_handover_;
  int64_t first_ns_ = 0;     ///< recorded, of this lap
  int64_t latest_ns_ = -1;   ///< likewise; -1: none yet
  int64_t offset_ns_ = 0;    ///< recorded stamp to new stamp
  int64_t last_lap_ns_ = 0;  ///< length
  int64_t last_offset_ns_ = 0;
  int64_t lateness_ns_ = 0;
  std::map<int64_t, int64_t> handovers_;  ///< recorded stamp to moment of hand-over
};

}  // namespace pi_os_transport
