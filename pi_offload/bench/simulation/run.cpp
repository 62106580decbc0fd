#include "simulation/run.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace pi_offload::simulation
{
namespace
{

constexpr int64_t NEVER = std::numeric_limits<int64_t>::max();
constexpr double LONGEST_TASK_S = 60.0;  ///< a task without a result this long after the last task has none

}  // namespace

Run::Run(const World& world, const std::string& policy)
  : world_(world), scenario_(world.scenario()), informed_(policy == "informed")
{
  const size_t node_count = scenario_.nodes.size();
  pending_.resize(node_count);
  node_event_ns_.assign(node_count, NEVER);
  down_.assign(node_count, false);
  for (size_t n = 0; n < node_count; ++n)
  {
    node_of_[scenario_.nodes[n].description.id] = n;
    nodes_.emplace_back(world_, n);
    for (const Outage& outage : world_.outages(n))
    {
      push(outage.begin_ns, Event::Type::NODE_DOWN, 0, n, outage.silent ? 1 : 0);
      push(outage.end_ns, Event::Type::NODE_UP, 0, n, 0);
    }
  }
  vehicles_.resize(static_cast<size_t>(scenario_.vehicles));
  for (size_t v = 0; v < vehicles_.size(); ++v)
  {
    vehicles_[v].name = "vehicle" + std::to_string(v);
    vehicles_[v].link_up.assign(node_count, true);
    tasks_left_ += world_.tasks(v).size();
    if (!world_.tasks(v).empty())
    {
      push(world_.tasks(v).front().created_ns, Event::Type::TASK, v, 0, 0);
    }
    if (policy != "oracle" && !informed_)
    {
      makeEngine(v, policy);
    }
  }
}

void Run::makeEngine(size_t v, const std::string& policy)
{
  EngineOptions options = scenario_.engine;
  options.policy_name = policy;
  OffloadEngine::Actions actions;
  actions.send = [this, v](const std::string& node, uint64_t request, const Task& task)
  { return sendTask(v, nodeIndex(node), request, task); };
  actions.probe = [this, v](const std::string& node, uint64_t request)
  { return sendProbe(v, nodeIndex(node), request); };
  actions.run_local = [this, v](const Task& task, double frequency_ghz) { runLocal(v, task, frequency_ghz); };
  actions.cancel = [this, v](const std::string& node, uint64_t request) { sendCancel(v, nodeIndex(node), request); };
  actions.deliver = [this, v](const Outcome& outcome) { onOutcome(v, outcome); };
  Vehicle& vehicle = vehicles_[v];
  vehicle.engine = std::make_unique<OffloadEngine>(options, std::move(actions));
  updateVehicle(&vehicle, v);
  for (const Scenario::Node& node : scenario_.nodes)
  {
    vehicle.engine->setNode(node.description, now_ns_);
    vehicle.engine->onLinkUp(node.description.id, now_ns_);
  }
  wakeEngine(v);
}

SimulationResult Run::run()
{
  const int64_t last_ns = toNs(scenario_.duration_s + LONGEST_TASK_S);
  while (tasks_left_ > 0 && !events_.empty() && events_.top().at_ns <= last_ns)
  {
    const Event event = events_.top();
    events_.pop();
    now_ns_ = event.at_ns;
    handle(event);
  }
  return result();
}

void Run::push(int64_t at_ns, Event::Type type, size_t vehicle, size_t node, uint64_t id)
{
  Event event;
  event.at_ns = at_ns;
  event.serial = next_serial_++;
  event.type = type;
  event.vehicle = static_cast<uint32_t>(vehicle);
  event.node = static_cast<uint32_t>(node);
  event.id = id;
  events_.push(event);
}

void Run::handle(const Event& event)
{
  switch (event.type)
  {
    case Event::Type::TASK:
    {
      const std::vector<Task>& tasks = world_.tasks(event.vehicle);
      if (event.id + 1 < tasks.size())
      {
        push(tasks[event.id + 1].created_ns, Event::Type::TASK, event.vehicle, 0, event.id + 1);
      }
      onTask(event.vehicle, tasks[event.id]);
      break;
    }
    case Event::Type::ENGINE:
    {
      Vehicle& vehicle = vehicles_[event.vehicle];
      if (event.at_ns == vehicle.engine_event_ns)
      {
        vehicle.engine_event_ns = NEVER;
        updateVehicle(&vehicle, event.vehicle);
        vehicle.engine->onTime(now_ns_);
        wakeEngine(event.vehicle);
      }
      break;
    }
    case Event::Type::ARRIVAL:
      onArrival(event);
      break;
    case Event::Type::PROBE_ARRIVAL:
      onProbeArrival(event);
      break;
    case Event::Type::CANCEL:
      if (!down_[event.node])
      {
        nodes_[event.node].cancel(event.id);
      }
      break;
    case Event::Type::NODE:
      if (event.at_ns == node_event_ns_[event.node])
      {
        node_event_ns_[event.node] = NEVER;
        onNode(event.node);
      }
      break;
    case Event::Type::REPLY:
      onReply(event.id);
      break;
    case Event::Type::LOCAL_DONE:
      onLocalDone(event.id);
      break;
    case Event::Type::NODE_DOWN:
      down_[event.node] = true;
      if (event.id == 0)
      {
        onNodeDown(event.node);
      }
      break;
    case Event::Type::NODE_UP:
      onNodeUp(event.node);
      break;
    case Event::Type::LINK_UP:
      onLinkUp(event.vehicle, event.node);
      break;
    case Event::Type::FALLBACK:
      onFallback(event.vehicle, event.id);
      break;
  }
}

}  // namespace pi_offload::simulation
