#include "recorder/incident_plan.h"

#include <algorithm>

namespace pi_vehicle::recorder
{

/// While nothing can be written incidents wait, so many at most; then the last one is extended.
constexpr size_t MOST_INCIDENTS = 20;
constexpr size_t MOST_TRIGGERS = 100;  // of one incident that are kept for a further file of it

bool IncidentPlan::joins(int64_t now_ns) const
{
  return incidents_.size() >= MOST_INCIDENTS ||
         (!incidents_.empty() && incidents_.back().to_ns >= now_ns &&
          now_ns + window_.after_ns - incidents_.back().from_ns <= window_.longest_ns);
}

std::optional<std::string> IncidentPlan::nameFor(int64_t now_ns) const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return joins(now_ns) ? std::make_optional(incidents_.back().name) : std::nullopt;
}

void IncidentPlan::trigger(const KeptMessagePtr& message, const std::string& name)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  const int64_t now_ns = message->elapsed_ns;
  const int64_t end_ns = now_ns + window_.after_ns;
  if (joins(now_ns))
  {
    incidents_.back().to_ns = end_ns;
    if (incidents_.back().triggers.size() < MOST_TRIGGERS)
    {
      incidents_.back().triggers.push_back(message);
    }
    return;
  }
  if (!incidents_.empty())
  {
    incidents_.back().to_ns = std::min(incidents_.back().to_ns, now_ns);  // the new one holds this time and before_ns
  }
  incidents_.push_back({name, std::max(now_ns - window_.before_ns, cut_ns_), end_ns, {message}});
}

void IncidentPlan::cut(int64_t now_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  cut_ns_ = now_ns;
  for (Incident& incident : incidents_)
  {
    incident.to_ns = std::min(incident.to_ns, now_ns - 1);
  }
}

std::optional<Incident> IncidentPlan::current() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return incidents_.empty() ? std::nullopt : std::make_optional(incidents_.front());
}

bool IncidentPlan::endIfOver(int64_t complete_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (incidents_.empty() || incidents_.front().to_ns >= complete_ns)
  {
    return false;
  }
  incidents_.pop_front();
  return true;
}

std::optional<int64_t> IncidentPlan::firstNs() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  if (incidents_.empty())
  {
    return std::nullopt;
  }
  int64_t first_ns = incidents_.front().from_ns;
  for (const Incident& incident : incidents_)
  {
    first_ns = std::min(first_ns, incident.from_ns);
  }
  return first_ns;
}

}  // namespace pi_vehicle::recorder
