#include "server/fair_queue.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace pi_offload
{

FairQueue::Vehicle* FairQueue::find(const std::string& name)
{
  const auto found =
      std::find_if(vehicles_.begin(), vehicles_.end(), [&](const Vehicle& vehicle) { return vehicle.name == name; });
  return found != vehicles_.end() ? &*found : nullptr;
}

const FairQueue::Vehicle* FairQueue::find(const std::string& name) const
{
  return const_cast<FairQueue*>(this)->find(name);
}

FairQueue::Vehicle& FairQueue::findOrAdd(const std::string& name)
{
  Vehicle* vehicle = find(name);
  if (vehicle != nullptr)
  {
    return *vehicle;
  }
  if (vehicles_.size() >= max_vehicles_)
  {
    const auto idle = std::find_if(vehicles_.begin(), vehicles_.end(), [](const Vehicle& v) { return v.count() == 0; });
    if (idle != vehicles_.end())
    {
      vehicles_.erase(idle);
    }
  }
  vehicles_.emplace_back();
  vehicles_.back().name = name;
  for (size_t lane = 0; lane < LANES; ++lane)
  {
    vehicles_.back().lanes[lane].served_s = clock_s_[lane];
  }
  return vehicles_.back();
}

/// What counts of the service time that a vehicle has had.
double FairQueue::startTime(double served_s, double clock_s) const
{
  return std::clamp(served_s, clock_s - window_s_, clock_s + window_s_);
}

void FairQueue::add(QueuedTask task)
{
  task.serial = next_serial_++;
  std::vector<QueuedTask>& tasks = findOrAdd(task.task.vehicle).lanes[laneOf(task.covered)].tasks;
  const auto place =
      std::upper_bound(tasks.begin(), tasks.end(), task.deadline_ns,
                       [](int64_t deadline_ns, const QueuedTask& other) { return deadline_ns < other.deadline_ns; });
  tasks.insert(place, std::move(task));
  ++size_;
}

FairQueue::Plan FairQueue::startPlan(const QueuedTask* extra) const
{
  Plan plan;
  plan.clock_s = clock_s_;
  bool extra_done = extra == nullptr;
  for (const Vehicle& vehicle : vehicles_)
  {
    const bool with_extra = !extra_done && vehicle.name == extra->task.vehicle;
    for (size_t lane = 0; lane < LANES; ++lane)
    {
      const std::vector<QueuedTask>& tasks = vehicle.lanes[lane].tasks;
      const bool here = with_extra && laneOf(extra->covered) == lane;
      if (tasks.empty() && !here)
      {
        continue;
      }
      Plan::Entry entry;
      entry.served_s = vehicle.lanes[lane].served_s;
      entry.tasks.reserve(tasks.size() + 1);
      for (const QueuedTask& task : tasks)
      {
        entry.tasks.push_back(&task);
      }
      if (here)
      {
        entry.tasks.push_back(extra);
      }
      plan.lanes[lane].push_back(std::move(entry));
    }
    extra_done = extra_done || with_extra;
  }
  if (!extra_done)
  {
    Plan::Entry entry;
    entry.served_s = clock_s_[laneOf(extra->covered)];
    entry.tasks.push_back(extra);
    plan.lanes[laneOf(extra->covered)].push_back(std::move(entry));
  }
  return plan;
}

const QueuedTask* FairQueue::nextOf(Plan* plan) const
{
  for (size_t lane = 0; lane < LANES; ++lane)
  {
    plan->entry = nullptr;
    plan->lane = lane;
    for (Plan::Entry& entry : plan->lanes[lane])
    {
      if (entry.next == entry.tasks.size())
      {
        continue;
      }
      const double start_s = startTime(entry.served_s, plan->clock_s[lane]);
      if (plan->entry == nullptr || start_s < plan->start_s ||
          (start_s == plan->start_s && entry.tasks[entry.next]->serial < plan->entry->tasks[plan->entry->next]->serial))
      {
        plan->entry = &entry;
        plan->start_s = start_s;
      }
    }
    if (plan->entry != nullptr)
    {
      return plan->entry->tasks[plan->entry->next];
    }
  }
  return nullptr;
}

void FairQueue::advance(Plan* plan, const Services& services, bool served)
{
  const QueuedTask* task = plan->entry->tasks[plan->entry->next++];
  if (served)
  {
    double& clock_s = plan->clock_s[plan->lane];
    clock_s = std::max(clock_s, plan->start_s);
    plan->entry->served_s = plan->start_s + services[static_cast<size_t>(task->task.kind)];
  }
}

std::optional<QueuedTask> FairQueue::pop(const Services& services)
{
  Plan plan = startPlan(nullptr);
  const QueuedTask* next = nextOf(&plan);
  if (next == nullptr)
  {
    return std::nullopt;
  }
  const double cost_s = services[static_cast<size_t>(next->task.kind)];
  Vehicle& vehicle = *find(next->task.vehicle);
  Lane& lane = vehicle.lanes[plan.lane];
  double& clock_s = clock_s_[plan.lane];
  clock_s = std::max(clock_s, plan.start_s);
  lane.served_s = plan.start_s + cost_s;
  if (plan.lane == 0)
  {
    // Who has a lease has had it before those without one as well.
    vehicle.lanes[1].served_s = startTime(vehicle.lanes[1].served_s, clock_s_[1]) + cost_s;
  }
  QueuedTask task = std::move(lane.tasks.front());
  lane.tasks.erase(lane.tasks.begin());
  --size_;
  return task;
}

void FairQueue::correct(const std::string& vehicle, bool covered, double more_s)
{
  Vehicle* found = find(vehicle);
  if (found != nullptr)
  {
    for (size_t lane = laneOf(covered); lane < LANES; ++lane)
    {
      found->lanes[lane].served_s += more_s;
    }
  }
}

std::optional<QueuedTask> FairQueue::remove(uint64_t ticket)
{
  std::vector<QueuedTask> removed = removeIf([&](const QueuedTask& task) { return task.task.ticket == ticket; });
  return removed.empty() ? std::nullopt : std::optional<QueuedTask>(std::move(removed.front()));
}

std::vector<QueuedTask> FairQueue::removeVehicle(const std::string& vehicle)
{
  std::vector<QueuedTask> removed = removeIf([&](const QueuedTask& task) { return task.task.vehicle == vehicle; });
  vehicles_.erase(
      std::remove_if(vehicles_.begin(), vehicles_.end(), [&](const Vehicle& other) { return other.name == vehicle; }),
      vehicles_.end());
  return removed;
}

size_t FairQueue::count(const std::string& vehicle) const
{
  const Vehicle* found = find(vehicle);
  return found != nullptr ? found->count() : 0;
}

double FairQueue::ahead(const std::string& vehicle, bool covered) const
{
  const Vehicle* found = find(vehicle);
  const size_t lane = laneOf(covered);
  if (found == nullptr || !(window_s_ > 0.0))
  {
    return 0.0;
  }
  return (startTime(found->lanes[lane].served_s, clock_s_[lane]) - clock_s_[lane]) / window_s_;
}

const QueuedTask* FairQueue::lastOfLongest(size_t at_least) const
{
  const Vehicle* longest = nullptr;
  for (const Vehicle& vehicle : vehicles_)
  {
    if (vehicle.count() >= std::max<size_t>(at_least, 1) && (longest == nullptr || vehicle.count() > longest->count()))
    {
      longest = &vehicle;
    }
  }
  if (longest == nullptr)
  {
    return nullptr;
  }
  const Lane& lane = longest->lanes[longest->lanes[1].tasks.empty() ? 0 : 1];
  return &lane.tasks.back();
}

}  // namespace pi_offload
