#pragma once

#include "recorder/message_memory.h"

#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle::recorder
{

/// A piece of time that becomes a file.
struct Incident
{
  std::string name;                      ///< of the file, without folder and ending
  int64_t from_ns = 0;                   ///< elapsed, of the first message
  int64_t to_ns = 0;                     ///< elapsed, of the last one
  std::vector<KeptMessagePtr> triggers;  ///< messages on topic `incident`
};

struct IncidentWindow
{
  int64_t before_ns = 0;   ///< from the first message to the trigger
  int64_t after_ns = 0;    ///< from the last trigger to the last message
  int64_t longest_ns = 0;  ///< a trigger that would make the incident longer begins the next one
};

/// Which incidents are to be written. A trigger during an incident extends it. Thread safe.
class IncidentPlan
{
public:
  explicit IncidentPlan(const IncidentWindow& window) : window_(window) {}

  /// Name of the file that a trigger at this time would join; none: it begins a new one.
  std::optional<std::string> nameFor(int64_t now_ns) const;
  /// @param message  on topic `incident`; its elapsed_ns is the time of the trigger.
  /// @param name  of the file, if it is a new one.
  void trigger(const KeptMessagePtr& message, const std::string& name);
  /// Messages from before this time belong to no incident from now on; one that is open ends here.
  void cut(int64_t now_ns);

  /// The incident to write now.
  std::optional<Incident> current() const;
  /// Ends the current incident if all up to complete_ns is written, and the last message is before that.
  /// @return whether it ended.
  bool endIfOver(int64_t complete_ns);
  /// Of all incidents to write.
  std::optional<int64_t> firstNs() const;

private:
  bool joins(int64_t now_ns) const;

  const IncidentWindow window_;
  mutable std::mutex mutex_;
  std::deque<Incident> incidents_;
  int64_t cut_ns_ = 0;
};

}  // namespace pi_vehicle::recorder
