#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>

namespace pi_slam
{

/// An input topic and when its last message came. note() is called on one thread; the rest may be called on any.
struct InputTopic
{
  using Clock = std::chrono::steady_clock;

  void note()
  {
    ++messages;
    came_at = Clock::now().time_since_epoch().count();
  }
  /// Since the last message; before the first one, since the construction.
  double silentSeconds() const
  {
    return std::chrono::duration<double>(Clock::now().time_since_epoch() - Clock::duration(came_at)).count();
  }

  std::string topic;  ///< resolved name
  std::atomic<uint64_t> messages{0};
  std::atomic<Clock::rep> came_at{Clock::now().time_since_epoch().count()};
};

struct VioTopics
{
  InputTopic imu;
  InputTopic pictures[2];  ///< LEFT, RIGHT
  InputTopic infos[2];
};

}  // namespace pi_slam
