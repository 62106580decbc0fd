#pragma once

#include <pi_node/durations.h>
#include <pi_node/vehicle_clock.h>

#include <atomic>
#include <cstdint>
#include <string>

namespace pi_node
{

/// An input topic and when its last message came, in the vehicle's time. Any thread may call any method once the name
/// is set.
struct InputTopic
{
  void note()
  {
    ++messages;
    restart();
  }
  /// Silence is counted from now on.
  void restart() { came_at_ns = vehicleNs(); }
  /// Since the last message or restart(), or else the construction.
  double silentSeconds() const { return secondsBetween(came_at_ns, vehicleNs()); }

  std::string topic;  ///< resolved name
  std::atomic<uint64_t> messages{0};
  std::atomic<int64_t> came_at_ns{vehicleNs()};
};

}  // namespace pi_node
