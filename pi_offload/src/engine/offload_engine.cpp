#include "engine/engine_impl.h"

#include <pi_node/option_check.h>

#include <cmath>
#include <stdexcept>

namespace pi_offload
{
namespace
{
std::array<double, TASK_KINDS> firstLocalTimes(const EngineOptions& options)
{
  std::array<double, TASK_KINDS> times{};
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    times[kind] = localCost(options.needs[kind], options.computer).time_s;
  }
  return times;
}

EngineOptions checked(const EngineOptions& options)
{
  options.validate();
  return options;
}

void require(bool there, const char* name)
{
  if (!there)
  {
    throw std::invalid_argument(std::string("actions/") + name + " is empty, must be a function");
  }
}
}  // namespace

void EngineOptions::validate() const
{
  policy.validate();
  estimates.validate();
  computer.validate();
  radio.validate();
  const pi_node::OptionCheck check("engine");
  check.range("eta", eta, 0.0, 1.0);
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    const pi_node::OptionCheck of_kind(std::string("engine/needs/") + toString(static_cast<TaskKind>(kind)));
    of_kind.positive("work_gcycles", needs[kind].work_gcycles);
    of_kind.range("work_gcycles", needs[kind].work_gcycles, 0.0, 1e6);
    of_kind.range("input_mbit", needs[kind].input_mbit, 0.0, 1e6);
    of_kind.range("output_mbit", needs[kind].output_mbit, 0.0, 1e6);
    of_kind.range("deadline_s", needs[kind].deadline_s, 1e-3, 3600.0);
  }
  check.range("advertisement_valid_s", advertisement_valid_s, 0.01, 3600.0);
  check.range("probe_period_s", probe_period_s, 0.01, 60.0);
  check.range("probe_period_far_s", probe_period_far_s, probe_period_s, 3600.0);
  check.range("max_failures", max_failures, 1, 1000);
  check.range("max_in_flight", max_in_flight, size_t{0}, size_t{65536});
  check.range("local_lost_s", local_lost_s, 0.1, 3600.0);
}

OffloadEngine::Impl::Impl(const EngineOptions& given, Actions given_actions)
  : options(checked(given))
  , actions(std::move(given_actions))
  , policy(makePolicy(given.policy_name, given.policy))
  , local(firstLocalTimes(given), given.computer.frequency_ghz)
{
  require(static_cast<bool>(actions.send), "send");
  require(static_cast<bool>(actions.probe), "probe");
  require(static_cast<bool>(actions.run_local), "run_local");
  require(static_cast<bool>(actions.deliver), "deliver");
  for (DecisionInput* in : {&input, &local_input})
  {
    in->computer = options.computer;
    in->radio = options.radio;
  }
}

OffloadEngine::OffloadEngine(const EngineOptions& options, Actions actions)
  : impl_(std::make_unique<Impl>(options, std::move(actions)))
{
}

OffloadEngine::~OffloadEngine() = default;

void OffloadEngine::setNode(const NodeDescription& node, int64_t now_ns)
{
  impl_->setTime(now_ns);
  impl_->setNode(node);
}

bool OffloadEngine::removeNode(const std::string& id, int64_t now_ns)
{
  impl_->setTime(now_ns);
  const bool removed = impl_->removeNode(id);
  impl_->raise();
  return removed;
}

void OffloadEngine::setTrusted(const std::string& id, bool trusted, int64_t now_ns)
{
  impl_->setTime(now_ns);
  if (NodeState* state = impl_->find(id))
  {
    state->trusted = trusted;
    if (!trusted)
    {
      impl_->fallBackAll(state->key, "the node is not trusted", false, true);
    }
  }
  impl_->raise();
}

void OffloadEngine::onExtraRun(uint64_t run, TaskKind kind, int64_t now_ns)
{
  impl_->setTime(now_ns);
  const LocalComputer& computer = impl_->options.computer;
  const auto k = static_cast<size_t>(kind);
  impl_->local.start(run, kind, computer.frequency_ghz, impl_->now);
  impl_->statistics.of_kind[k].energy_j += localCost(impl_->options.needs[k], computer).energy_j;
}

void OffloadEngine::setVehicle(const VehicleState& vehicle)
{
  impl_->setVehicle(vehicle);
}

void OffloadEngine::setRoute(const std::vector<Point>& route)
{
  impl_->setRoute(route);
}

void OffloadEngine::setPolicy(const std::string& name)
{
  impl_->policy = makePolicy(name, impl_->options.policy);
  impl_->options.policy_name = name;
}

void OffloadEngine::setPolicyOptions(const PolicyOptions& options)
{
  impl_->policy = makePolicy(impl_->options.policy_name, options);
  impl_->options.policy = options;
}

void OffloadEngine::setEta(double eta)
{
  pi_node::OptionCheck("engine").range("eta", eta, 0.0, 1.0);
  impl_->options.eta = eta;
}

void OffloadEngine::setEnabled(bool enabled, int64_t now_ns)
{
  impl_->setTime(now_ns);
  impl_->setEnabled(enabled);
  impl_->raise();
}

Decision OffloadEngine::decide(TaskKind kind, size_t input_bytes, double deadline_s, int64_t now_ns)
{
  const auto k = static_cast<size_t>(kind);
  if (k >= TASK_KINDS || !(deadline_s >= 0.0 && std::isfinite(deadline_s)))
  {
    throw std::invalid_argument(k >= TASK_KINDS
                                    ? "kind = " + std::to_string(k) + ", must be below " + std::to_string(TASK_KINDS)
                                    : "deadline_s = " + std::to_string(deadline_s) + ", must be finite and at least 0");
  }
  impl_->setTime(now_ns);
  return impl_->decide(kind, input_bytes, deadline_s > 0.0 ? deadline_s : impl_->options.needs[k].deadline_s, -1);
}

Decision OffloadEngine::submit(const Task& task, int64_t now_ns)
{
  impl_->setTime(now_ns);
  const Decision decision = impl_->submit(task);
  impl_->raise();
  return decision;
}

bool OffloadEngine::onReply(const std::string& node, uint64_t request, const RequestTiming& timing,
                            const NodeAdvertisement& advertisement, int64_t now_ns)
{
  impl_->setTime(now_ns);
  const bool result = impl_->onReply(node, request, timing, advertisement);
  impl_->raise();
  return result;
}

void OffloadEngine::onRefused(const std::string& node, uint64_t request, const NodeAdvertisement* advertisement,
                              int64_t now_ns)
{
  impl_->setTime(now_ns);
  impl_->onRefused(node, request, advertisement);
  impl_->raise();
}

void OffloadEngine::onProbeReply(const std::string& node, uint64_t request, double round_trip_s,
                                 const NodeAdvertisement& advertisement, int64_t now_ns)
{
  impl_->setTime(now_ns);
  impl_->onProbeReply(node, request, round_trip_s, advertisement);
}

void OffloadEngine::onLinkDown(const std::string& node, int64_t now_ns)
{
  impl_->setTime(now_ns);
  if (NodeState* state = impl_->find(node))
  {
    state->link_up = false;
    state->probe = 0;
    impl_->fallBackAll(state->key, "the link broke", true, false);
  }
  impl_->raise();
}

void OffloadEngine::onLinkUp(const std::string& node, int64_t now_ns)
{
  impl_->setTime(now_ns);
  if (NodeState* state = impl_->find(node))
  {
    state->link_up = true;
    state->probe_soon = true;
    state->estimates.forgetNetwork();
  }
}

bool OffloadEngine::onLocalDone(uint64_t task, double work_s, int64_t now_ns)
{
  impl_->setTime(now_ns);
  const bool result = impl_->onLocalDone(task, work_s);
  impl_->raise();
  return result;
}

void OffloadEngine::onLocalFailed(uint64_t task, int64_t now_ns)
{
  impl_->setTime(now_ns);
  impl_->localFailed(task, "the vehicle failed");
  impl_->raise();
}

int64_t OffloadEngine::nextTime() const
{
  return impl_->nextTime();
}

void OffloadEngine::onTime(int64_t now_ns)
{
  impl_->setTime(now_ns);
  impl_->onTime();
  impl_->raise();
}

size_t OffloadEngine::inFlight() const
{
  return impl_->tasks.size();
}

double OffloadEngine::leaseRate(const std::string& node, TaskKind kind, int64_t now_ns) const
{
  impl_->setTime(now_ns);
  return static_cast<size_t>(kind) < TASK_KINDS ? impl_->leaseRate(node, kind) : 0.0;
}

std::vector<OffloadEngine::NodeStatus> OffloadEngine::nodes(int64_t now_ns) const
{
  impl_->setTime(now_ns);
  std::vector<NodeStatus> list;
  list.reserve(impl_->nodes.size());
  for (const std::unique_ptr<NodeState>& node : impl_->nodes)
  {
    list.push_back(impl_->status(*node));
  }
  return list;
}

const OffloadEngine::Statistics& OffloadEngine::statistics() const
{
  return impl_->statistics;
}

const std::string& OffloadEngine::lastNode(TaskKind kind) const
{
  return impl_->last.at(static_cast<size_t>(kind)).name;
}

}  // namespace pi_offload
