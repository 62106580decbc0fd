#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>

#include "event_loop/event_loop.h"

namespace pi_os_transport
{

/// Counts what other machines sent and the bridge refused, and logs each kind of refusal at most once a minute.
class Refusals
{
public:
  enum Reason
  {
    UNKNOWN_PEER,
    WRONG_VERSION,
    OVERSIZED,
    MALFORMED,
    BAD_SESSION,
    UNTRUSTED,   ///< a connection whose ends have not proved who they are
    NO_SERVICE,  ///< a tunnel to a port that is no service
  };
  static constexpr std::array<const char*, 7> NAMES{"unknown_peer", "wrong_version", "oversized", "malformed",
                                                    "bad_session",  "untrusted",     "no_service"};

  explicit Refusals(std::function<void(const std::string&)> log) : log_(std::move(log)) {}

  void count(Reason reason) { ++counters_[reason]; }
  void count(Reason reason, const std::string& text) { count(reason, text, text); }
  /// @param subject  texts about the same subject count as one
  void count(Reason reason, const std::string& subject, const std::string& text)
  {
    count(reason);
    warn(subject, text);
  }
  /// Logs without counting.
  void warn(const std::string& text) { warn(text, text); }
  void warn(const std::string& subject, const std::string& text)
  {
    const SteadyTime now = SteadyClock::now();
    if (logged_.size() > MAX_TEXTS)
    {
      logged_.clear();
    }
    const auto [known, is_new] = logged_.try_emplace(subject, now);
    if (is_new || now - known->second > LOG_INTERVAL)
    {
      known->second = now;
      log_(text);
    }
  }
  uint64_t counter(size_t reason) const { return counters_[reason]; }

private:
  static constexpr size_t MAX_TEXTS = 64;
  static constexpr std::chrono::seconds LOG_INTERVAL{60};

  const std::function<void(const std::string&)> log_;
  std::array<uint64_t, NAMES.size()> counters_{};
  std::map<std::string, SteadyTime> logged_;  ///< when each subject was logged last
};

}  // namespace pi_os_transport
