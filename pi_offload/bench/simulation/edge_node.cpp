#include "simulation/edge_node.h"

#include <algorithm>
#include <limits>

namespace pi_offload::simulation
{
namespace
{

constexpr uint64_t OTHERS_TICKET = 1ULL << 63U;

bool isOurs(uint64_t ticket)
{
  return (ticket & OTHERS_TICKET) == 0;
}

AdmissionOptions optionsOf(const Scenario& scenario, size_t node)
{
  AdmissionOptions options = scenario.admission;
  options.workers = scenario.nodes[node].workers;
  options.frequency_ghz = scenario.nodes[node].description.frequency_ghz;
  return options;
}

}  // namespace

EdgeNode::EdgeNode(const World& world, size_t node)
  : world_(&world)
  , node_(node)
  , options_(optionsOf(world.scenario(), node))
  , admission_(options_)
  , others_(&world.others(node))
{
}

EdgeNode EdgeNode::withOthers(const std::vector<OthersTask>* others) const
{
  EdgeNode copy = *this;
  copy.others_ = others;
  copy.next_other_ = 0;
  return copy;
}

size_t EdgeNode::firstToEnd() const
{
  size_t first = 0;
  for (size_t i = 1; i < running_.size(); ++i)
  {
    first = running_[i].ends_ns < running_[first].ends_ns ? i : first;
  }
  return first;
}

int64_t EdgeNode::nextTime() const
{
  if (ours_queued_ + ours_running_ == 0)
  {
    return std::numeric_limits<int64_t>::max();
  }
  int64_t at_ns = running_.empty() ? std::numeric_limits<int64_t>::max() : running_[firstToEnd()].ends_ns;
  const std::vector<OthersTask>& others = *others_;
  if (ours_queued_ > 0 && next_other_ < others.size())
  {
    at_ns = std::min(at_ns, others[next_other_].arrived_ns);
  }
  return at_ns;
}

void EdgeNode::advance(int64_t now_ns, std::vector<End>* ends)
{
  const std::vector<OthersTask>& others = *others_;
  while (true)
  {
    const size_t first = firstToEnd();
    const int64_t end_ns = running_.empty() ? std::numeric_limits<int64_t>::max() : running_[first].ends_ns;
    const int64_t other_ns =
        next_other_ < others.size() ? others[next_other_].arrived_ns : std::numeric_limits<int64_t>::max();
    if (std::min(end_ns, other_ns) > now_ns)
    {
      return;
    }
    if (end_ns <= other_ns)
    {
      const Running task = std::move(running_[first]);
      running_.erase(running_.begin() + static_cast<std::ptrdiff_t>(first));
      admission_.finished(task.task.ticket, task.service_s, end_ns);
      busy_s_ += task.service_s;
      if (isOurs(task.task.ticket))
      {
        --ours_running_;
        ends->push_back({task.task.ticket, end_ns, true, toS(task.started_ns - task.task.arrived_ns), task.service_s});
      }
      start(end_ns, ends);
      continue;
    }
    const OthersTask& other = others[next_other_++];
    Arrival arrival;
    arrival.task.ticket = OTHERS_TICKET | next_other_;
    arrival.task.vehicle = "other" + std::to_string(other.vehicle);
    arrival.task.kind = other.kind;
    arrival.task.arrived_ns = other.arrived_ns;
    arrival.task.remaining_s = other.remaining_s;
    arrival.service_s = other.service_s;
    arrival.lease_hz = other.lease_hz;
    arrive(arrival, ends);
  }
}

Admission::Verdict EdgeNode::arrive(const Arrival& arrival, std::vector<End>* ends)
{
  const ServerTask& task = arrival.task;
  if (arrival.lease_hz > 0.0)
  {
    admission_.lease(task.vehicle, task.kind, arrival.lease_hz, task.arrived_ns);
  }
  const Admission::Verdict verdict = admission_.submit(task);
  if (verdict == Admission::Verdict::TAKEN)
  {
    service_s_[task.ticket] = arrival.service_s;
    ours_queued_ += isOurs(task.ticket) ? 1 : 0;
  }
  start(task.arrived_ns, ends);
  return verdict;
}

void EdgeNode::start(int64_t now_ns, std::vector<End>* ends)
{
  while (running_.size() < static_cast<size_t>(options_.workers) && admission_.queued() > 0)
  {
    std::optional<ServerTask> task = admission_.next(now_ns);
    if (!task)
    {
      break;
    }
    const auto service = service_s_.find(task->ticket);
    Running running;
    running.started_ns = now_ns;
    running.service_s = service->second;
    running.ends_ns = now_ns + toNs(running.service_s);
    service_s_.erase(service);
    if (isOurs(task->ticket))
    {
      --ours_queued_;
      ++ours_running_;
    }
    running.task = std::move(*task);
    running_.push_back(std::move(running));
  }
  dropExpired(now_ns, ends);
}

void EdgeNode::dropExpired(int64_t now_ns, std::vector<End>* ends)
{
  for (const ServerTask& task : admission_.takeExpired())
  {
    service_s_.erase(task.ticket);
    if (isOurs(task.ticket))
    {
      --ours_queued_;
      ends->push_back({task.ticket, now_ns, false, toS(now_ns - task.arrived_ns), 0.0});
    }
  }
}

void EdgeNode::cancel(uint64_t ticket)
{
  if (service_s_.count(ticket) != 0 && admission_.cancel(ticket))
  {
    service_s_.erase(ticket);
    --ours_queued_;
  }
}

void EdgeNode::askLease(const std::string& vehicle, TaskKind kind, double rate_hz, int64_t now_ns)
{
  admission_.lease(vehicle, kind, rate_hz, now_ns);
}

NodeAdvertisement EdgeNode::advertisement(const std::string& vehicle, int64_t now_ns) const
{
  NodeAdvertisement advertisement = admission_.advertisement(vehicle, now_ns);
  const NodeDescription& description = world_->scenario().nodes[node_].description;
  advertisement.has_position = true;
  advertisement.position = description.position;
  advertisement.range_m = description.range_m;
  return advertisement;
}

void EdgeNode::restart(int64_t now_ns)
{
  admission_ = Admission(options_);
  service_s_.clear();
  running_.clear();
  ours_queued_ = 0;
  ours_running_ = 0;
  const std::vector<OthersTask>& others = *others_;
  while (next_other_ < others.size() && others[next_other_].arrived_ns < now_ns)
  {
    ++next_other_;
  }
}

}  // namespace pi_offload::simulation
