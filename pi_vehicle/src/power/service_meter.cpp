#include "power/service_meter.h"

#include <fnmatch.h>
#include <pi_node/durations.h>

#include <algorithm>
#include <iterator>
#include <limits>
#include <set>
#include <stdexcept>
#include <utility>

namespace pi_vehicle::power
{
namespace
{

bool matches(const ServiceDescription& service, const std::string& thread)
{
  return std::any_of(service.threads.begin(), service.threads.end(),
                     [&thread](const std::string& pattern)
                     { return ::fnmatch(pattern.c_str(), thread.c_str(), 0) == 0; });
}

}  // namespace

void ServiceDescription::validate() const
{
  if (name.empty())
  {
    throw std::invalid_argument("a service has no name; give it one");
  }
  if (nodes.empty())
  {
    throw std::invalid_argument("service " + name + " has no nodes, must have at least one");
  }
  for (const std::vector<std::string>* list : {&nodes, &threads})
  {
    if (std::find(list->begin(), list->end(), "") != list->end())
    {
      throw std::invalid_argument("service " + name + " has an empty name among its " +
                                  (list == &nodes ? "nodes" : "threads") + "; leave it out");
    }
  }
}

void validateServices(const std::vector<ServiceDescription>& services)
{
  std::set<std::string> names;
  for (const ServiceDescription& service : services)
  {
    service.validate();
    if (!names.insert(service.name).second)
    {
      throw std::invalid_argument("two services are named " + service.name + "; put their nodes into one");
    }
  }
}

std::vector<ServiceDescription> defaultServices()
{
  return {
      {"localisation", {"vio", "vehicle_manager"}, {"vio_*", "pi_slam_*"}, false},
      {"detection", {"ssd", "obstacles", "vehicle_manager"}, {"ssd_*", "obs_*"}, false},
      {"speech", {"recognizer", "microphone", "speech_manager", "vehicle_manager"}, {"speech_*", "mic*"}, false},
      {"offloading", {"coordinator", "vehicle_manager"}, {"offload_*"}, true},
      {"decision",
       {"navigation", "reaction", "command", "arbiter", "announcer", "vehicle_manager"},
       {"nav*", "reaction*", "command*", "arbiter*", "announcer*"},
       false},
      {"chassis", {"chassis", "vehicle_manager"}, {"chassis*"}, false},
      {"runtime", {"runtime", "vehicle_manager"}, {"pi_cpu*", "pi_gpu*", "pi_watch"}, true},
      {"sensors", {"player", "camera", "left_camera", "right_camera", "imu"}, {"playback", "prefetch"}, true},
      {"power", {"power", "vehicle_manager"}, {"power*"}, true},
      {"recording", {"recorder", "vehicle_manager"}, {"recorder*"}, true},
      {"web", {"web_view"}, {"web_*"}, true},
  };
}

ServiceMeter::ServiceMeter(std::vector<ServiceDescription> services, ProcessFiles files, double memory_period_s)
  : services_(std::move(services))
  , files_(std::move(files))
  , memory_period_ns_(static_cast<int64_t>(1e9 * memory_period_s))
{
  validateServices(services_);
}

ServiceMeter::Spent ServiceMeter::spent(int32_t pid, bool threads, bool memory, std::map<int32_t, Seen>* seen) const
{
  Spent spent;
  const std::optional<ProcessTime> time = files_.process(pid);
  if (!time)
  {
    return spent;
  }
  const auto before = seen_.find(pid);
  const bool known = before != seen_.end() && before->second.time.start_ticks == time->start_ticks;
  Seen& now = (*seen)[pid];
  now.time = *time;
  spent.process_s = known ? std::max(time->cpu_s - before->second.time.cpu_s, 0.0) : 0.0;
  if (threads)
  {
    for (const ThreadTime& thread : files_.threads(pid))
    {
      now.threads[thread.tid] = thread.cpu_s;
      // A thread that began since then has spent all of its time since then.
      double earlier_s = known && !before->second.threads.empty() ? 0.0 : thread.cpu_s;
      if (known)
      {
        const auto same = before->second.threads.find(thread.tid);
        earlier_s = same != before->second.threads.end() ? same->second : earlier_s;
      }
      spent.threads.emplace_back(thread.name, std::max(thread.cpu_s - earlier_s, 0.0));
    }
  }
  now.memory =
      !memory && known ? before->second.memory : files_.memory(pid).value_or(std::numeric_limits<double>::quiet_NaN());
  spent.memory = now.memory;
  return spent;
}

std::map<int32_t, std::vector<size_t>> ServiceMeter::usersOf(const std::map<std::string, int32_t>& pids) const
{
  std::map<int32_t, std::vector<size_t>> users;
  for (size_t i = 0; i < services_.size(); ++i)
  {
    for (const std::string& node : services_[i].nodes)
    {
      if (const auto found = pids.find(node); found != pids.end() && files_.process(found->second))
      {
        std::vector<size_t>& of_process = users[found->second];
        if (of_process.empty() || of_process.back() != i)
        {
          of_process.push_back(i);
        }
      }
    }
  }
  return users;
}

void ServiceMeter::share(const Spent& process, const std::vector<size_t>& services, double period_s, MachineUse* use,
                         std::set<size_t>* working) const
{
  const auto cores = [period_s](double seconds) { return period_s > 0.0 ? seconds / period_s : 0.0; };
  ServiceUse& owner = services.size() == 1 ? use->services[services.front()] : use->shared;
  double rest_s = process.process_s;
  for (const auto& [thread, seconds] : process.threads)
  {
    const auto user =
        std::find_if(services.begin(), services.end(), [&](size_t i) { return matches(services_[i], thread); });
    if (user != services.end())
    {
      working->insert(*user);
      use->services[*user].cores += cores(seconds);
      rest_s -= seconds;
    }
  }
  owner.running = true;
  owner.cores += cores(std::max(rest_s, 0.0));
  owner.memory += process.memory;
}

MachineUse ServiceMeter::update(int64_t now_ns, const std::map<std::string, int32_t>& pids)
{
  MachineUse use;
  use.shared.name = "shared";
  use.other.name = "other";
  use.other.running = true;
  use.other.memory = std::numeric_limits<double>::quiet_NaN();
  for (const ServiceDescription& service : services_)
  {
    use.services.push_back({service.name, false, {}, 0.0, 0.0});
  }

  const double period_s = updated_ns_ > 0 ? pi_node::secondsBetween(updated_ns_, now_ns) : 0.0;
  const bool memory = memory_ns_ == 0 || now_ns - memory_ns_ >= memory_period_ns_;
  memory_ns_ = memory ? now_ns : memory_ns_;
  const auto cores = [period_s](double seconds) { return period_s > 0.0 ? seconds / period_s : 0.0; };
  std::map<int32_t, Seen> seen;
  double of_services = 0.0;
  for (const auto& [pid, services] : usersOf(pids))
  {
    const bool alone = services.size() == 1;
    const Spent process = spent(pid, !alone, memory, &seen);
    of_services += cores(process.process_s);
    std::set<size_t> working;  // services that have threads of their own there
    share(process, services, period_s, &use, &working);
    for (const size_t i : services)
    {
      if (!alone && !services_[i].threads.empty() && working.count(i) == 0)
      {
        continue;  // its nodelets are not loaded there
      }
      use.services[i].running = true;
      std::copy_if(services_[i].nodes.begin(), services_[i].nodes.end(), std::back_inserter(use.services[i].nodes),
                   [&, pid = pid](const std::string& node)
                   {
                     const auto found = pids.find(node);
                     return found != pids.end() && found->second == pid;
                   });
    }
  }
  seen_ = std::move(seen);

  use.busy_cores = of_services;
  if (const std::optional<MachineTime> machine = files_.machine())
  {
    use.cores = machine->cores;
    use.busy_cores = busy_s_ >= 0.0 ? std::max(cores(machine->busy_s - busy_s_), of_services) : of_services;
    busy_s_ = machine->busy_s;
  }
  use.other.cores = use.busy_cores - of_services;
  use.period_s = period_s;
  updated_ns_ = now_ns;
  return use;
}

}  // namespace pi_vehicle::power
