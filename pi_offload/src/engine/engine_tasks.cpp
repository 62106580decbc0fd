#include "engine/engine_impl.h"
#include "policies/policies.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace pi_offload
{
namespace
{
constexpr double LONGEST_DEADLINE_S = 3600.0;
/// A request counts as lost this long after its task's end [s].
constexpr double LATE_S = 10.0;
constexpr size_t MOST_CLOSED = 4096;
constexpr double TIDY_S = 1.0;
/// Residences computed again within one decision.
constexpr size_t RENEWALS_STRAIGHT = 32;
constexpr size_t RENEWALS_ROUTE = 2;
/// Margin of a fallback in deviations of the vehicle's time, if that is more than the policy's factor.
constexpr double LOCAL_DEVIATIONS = 5.0;
/// Least margin of a fallback [s]: the delay of a timer and a thread on a busy computer.
constexpr double LEAST_MARGIN_S = 0.01;
/// The node must answer within this part of the time between fallback and deadline. A later answer is of little use, as
/// the vehicle has nearly done the task; a refusal tells the vehicle at once.
constexpr double ANSWER_SHARE = 0.5;
/// A fallback is nearly due in the last part of its time.
constexpr double NEARLY_DUE = 0.25;
/// The budget of hedges is at most the energy of so many tasks' radio.
constexpr double MOST_HEDGES = 10.0;
/// Part of a node's account that is left after another task.
constexpr double ACCOUNT_KEPT = 0.99;
/// Rest of a node that lost against the vehicle; doubles each time in a row.
constexpr double FIRST_REST_S = 2.0;
constexpr int MOST_REST_DOUBLINGS = 5;

void reschedule(TaskTimes* times, int64_t* time_ns, uint64_t id, int64_t at_ns)
{
  if (*time_ns != NEVER_NS)
  {
    times->erase({*time_ns, id});
  }
  *time_ns = at_ns;
  if (at_ns != NEVER_NS)
  {
    times->insert({at_ns, id});
  }
}

}  // namespace

void OffloadEngine::Impl::fillInput(TaskKind kind, size_t bytes, double remaining_s, int refused, bool remote,
                                    DecisionInput* filled)
{
  const auto k = static_cast<size_t>(kind);
  DecisionInput& in = *filled;
  in.kind = kind;
  in.needs = options.needs[k];
  in.needs.input_mbit = static_cast<double>(bytes) * MBIT_PER_BYTE;
  in.needs.deadline_s = std::max(remaining_s, 1e-9);
  in.eta = options.eta;
  in.local_backlog_s = local.backlog(kind, now);
  in.local_s = local.measured(kind) ? local.seconds(kind) : 0.0;
  in.local_need_s = localNeed(kind);
  in.previous_node = -1;
  if (remote)
  {
    placeNodes(route.empty() ? RENEWALS_STRAIGHT : RENEWALS_ROUTE);
    const bool printed = options.policy_name == "paper_literal";
    for (size_t i = 0; i < nodes.size(); ++i)
    {
      NodeState& node = *nodes[i];
      NodeView& view = in.nodes[i];
      fillView(node, kind, in.needs.input_mbit, in.needs.output_mbit, view);
      if (printed)
      {
        view.printed_residence_s = vehicle.known ? printedResidence(vehicle.position, vehicle.heading, vehicle.speed,
                                                                    node.description.position, view.range_m)
                                                 : 0.0;
      }
    }
    if (const NodeState* previous = find(last[k].node))
    {
      in.previous_node = static_cast<int>(previous->index);
    }
    if (refused >= 0)
    {
      NodeView& view = in.nodes[static_cast<size_t>(refused)];
      view.connected = false;
      view.distance_m = std::numeric_limits<double>::infinity();
      view.range_m = 0.0;
      view.residence_s = 0.0;
      view.printed_residence_s = 0.0;
      view.capacity_gcycles = -1.0;
      in.previous_node = in.previous_node == refused ? -1 : in.previous_node;
    }
  }
}

Decision OffloadEngine::Impl::decide(TaskKind kind, size_t bytes, double remaining_s, int refused)
{
  const bool remote = enabled && open_requests < options.max_in_flight && remaining_s > 0.0;
  DecisionInput& in = remote ? input : local_input;
  fillInput(kind, bytes, remaining_s, refused, remote, &in);
  Decision decision = policy->decide(in);
  if (decision.node >= static_cast<int>(in.nodes.size()) || (refused >= 0 && decision.node == refused))
  {
    decision.node = -1;
  }
  if (decision.node < 0 && !(decision.frequency_ghz > 0.0))
  {
    decision.frequency_ghz = options.computer.frequency_ghz;
  }
  if (!remote)
  {
    decision.reason = !enabled               ? "offloading is switched off"
                      : !(remaining_s > 0.0) ? "its deadline is over"
                                             : "too many tasks at nodes";
  }
  return decision;
}

double OffloadEngine::Impl::localNeed(TaskKind kind) const
{
  return std::max(options.policy.fallback_factor * local.seconds(kind),
                  local.seconds(kind) + std::max(LOCAL_DEVIATIONS * local.deviation(kind), LEAST_MARGIN_S));
}

int64_t OffloadEngine::Impl::fallbackTime(const Decision& decision, const Task& task, int64_t deadline_ns) const
{
  const double need_s = localNeed(task.kind);
  if (!(decision.timeout_s > 0.0))
  {
    return later(deadline_ns, -toNs(need_s + local.backlog(task.kind, now)));
  }
  const int64_t policy_ns = later(now, toNs(decision.timeout_s));
  if (policy_ns >= deadline_ns)
  {
    return deadline_ns;  // no fallback is in time
  }
  const int64_t safe_ns = later(deadline_ns, -toNs(need_s));
  return safe_ns > now ? std::min(policy_ns, safe_ns) : policy_ns;
}

void OffloadEngine::Impl::checkTask(const Task& task) const
{
  const auto k = static_cast<size_t>(task.kind);
  std::ostringstream text;
  text << "task " << task.id;
  if (k >= TASK_KINDS)
  {
    text << ": kind = " << k << ", must be below " << TASK_KINDS;
    throw std::invalid_argument(text.str());
  }
  if (!(task.deadline_s >= 0.0 && task.deadline_s <= LONGEST_DEADLINE_S))
  {
    text << ": deadline_s = " << task.deadline_s << ", must be in [0, " << LONGEST_DEADLINE_S << "]";
    throw std::invalid_argument(text.str());
  }
  if (tasks.count(task.id) != 0 || local.running(task.id))
  {
    text << " is under way already, ids must be unique";
    throw std::invalid_argument(text.str());
  }
}

/// Turns a decision for a node into one for the vehicle.
void OffloadEngine::Impl::keepLocal(Decision* decision, const TaskState& state, const char* reason) const
{
  const TaskKind kind = state.task.kind;
  decision->node = -1;
  decision->timeout_s = 0.0;
  decision->frequency_ghz = options.computer.frequency_ghz;
  decision->expected_s = local.backlog(kind, now) + local.seconds(kind);
  decision->expected_j = localCost(options.needs[static_cast<size_t>(kind)], options.computer).energy_j;
  decision->expected_misses = decision->expected_s <= between(now, state.deadline_ns) ? 0.0 : 1.0;
  decision->reason = reason;
}

void OffloadEngine::Impl::expect(TaskState* state, const Decision& decision) const
{
  state->expected_s = between(state->task.created_ns, now) + decision.expected_s;
  state->expected_j = decision.expected_j;
  state->expected_misses = decision.expected_misses;
}

Decision OffloadEngine::Impl::submit(const Task& given)
{
  checkTask(given);
  const auto k = static_cast<size_t>(given.kind);
  Task task = given;
  task.deadline_s = given.deadline_s > 0.0 ? given.deadline_s : options.needs[k].deadline_s;
  forgetOld();
  Last& of_kind = last[k];
  if (of_kind.submitted_ns != LONG_AGO_NS)
  {
    of_kind.interval_s.add(between(of_kind.submitted_ns, now));
  }
  of_kind.submitted_ns = now;
  ++statistics.of_kind[k].tasks;

  const int64_t deadline_ns = later(task.created_ns, toNs(task.deadline_s));
  Decision decision = decide(task.kind, task.input_bytes, between(now, deadline_ns), -1);
  TaskState& state = tasks[task.id];
  state.task = task;
  state.deadline_ns = deadline_ns;
  state.reason = decision.reason;
  if (decision.node >= 0)
  {
    const int64_t fallback_ns = fallbackTime(decision, task, deadline_ns);
    if (fallback_ns <= now)
    {
      keepLocal(&decision, state, "no time for a fallback");
    }
    else
    {
      decision.timeout_s = between(now, fallback_ns);
      expect(&state, decision);
      if (sendTo(task.id, decision, fallback_ns))
      {
        return decision;
      }
      keepLocal(&decision, tasks.at(task.id), "the link takes nothing");
    }
  }
  of_kind.node = 0;
  of_kind.name.clear();
  expect(&tasks.at(task.id), decision);
  startOverdue(task.id, decision.frequency_ghz);
  startLocal(task.id, decision.frequency_ghz, decision.reason);
  return decision;
}

/// Counts a task as sent to the node. @return the number of its request.
uint64_t OffloadEngine::Impl::openRequest(NodeState& node, const Task& task)
{
  const Estimate answer = answerTime(input, input.nodes[node.index], options.policy);
  const QueueForecast forecast = queue(node, task.kind, uplinkTime(node, task.kind));
  Request request;
  request.task = task.id;
  request.node = node.key;
  request.kind = task.kind;
  request.bytes = task.input_bytes;
  request.sent_ns = now;
  request.expected_queue_s = forecast.estimate.mean - node.own_share * forecast.own_s;
  request.expected_own_s = forecast.own_s;
  request.answer_s = answer;
  request.rate_mbps = node.estimates.rate(now);
  const uint64_t number = ++last_request;
  requests[number] = request;
  ++open_requests;
  const double sending_s = static_cast<double>(task.input_bytes) * MBIT_PER_BYTE / node.estimates.rate(now);
  uplink_until_ns = later(std::max(now, uplink_until_ns), toNs(sending_s));
  node.own.push_back({number, task.kind, now});
  ++node.sent;
  NodeState::OfKind& of_kind = node.of_kind[static_cast<size_t>(task.kind)];
  of_kind.tokens = std::max(0.0, tokens(node, task.kind) - 1.0);
  of_kind.tokens_ns = now;
  return number;
}

bool OffloadEngine::Impl::sendTo(uint64_t id, const Decision& decision, int64_t fallback_ns)
{
  NodeState& node = *nodes[static_cast<size_t>(decision.node)];
  const uint64_t key = node.key;
  const std::string name = node.description.id;
  TaskState& state = tasks.at(id);
  Task asked = state.task;
  const auto k = static_cast<size_t>(asked.kind);
  const int64_t uplink_before_ns = uplink_until_ns;
  const uint64_t number = openRequest(node, asked);

  state.requests = {number, 0};
  state.node = name;
  state.first_node = key;
  state.sent_ns = now;
  state.reason = decision.reason;
  setTimer(state, fallback_ns);
  if (decision.hedge_s > 0.0)
  {
    setHedge(state, later(now, toNs(decision.hedge_s)));
  }

  Last& of_kind = last[k];
  const uint64_t node_before = std::exchange(of_kind.node_before, key);
  of_kind.node = key;
  of_kind.name = name;
  const bool handover = node_before != 0 && node_before != key;
  statistics.of_kind[k].handovers += handover ? 1 : 0;

  state.latest_ns = std::max(fallback_ns, later(state.deadline_ns, -toNs(localNeed(asked.kind))));
  if (fallback_ns < state.deadline_ns)
  {
    asked.deadline_s = usefulUntil(state);
  }
  bool sent = false;
  call([&] { sent = actions.send(name, number, asked); });
  const auto found = requests.find(number);
  if (sent || found == requests.end() || !found->second.open)
  {
    return true;  // sent, or answered, refused or called back within the action
  }
  uplink_until_ns = uplink_before_ns;
  requests.erase(found);
  --open_requests;
  if (NodeState* same = find(key))
  {
    forgetOwn(*same, number);
    --same->sent;
  }
  TaskState& unsent = tasks.at(id);
  unsent.requests = {};
  unsent.first_node = 0;
  setHedge(unsent, NEVER_NS);
  if (unsent.local || unsent.local_failed)
  {
    return true;  // the link broke within the action, and the vehicle does the task already
  }
  setTimer(unsent, NEVER_NS);
  statistics.of_kind[k].handovers -= handover ? 1 : 0;
  last[k].node_before = node_before;
  last[k].node = 0;
  last[k].name.clear();
  return false;
}

double OffloadEngine::Impl::usefulUntil(const TaskState& state) const
{
  const int64_t latest_ns = state.latest_ns;
  return between(state.task.created_ns, later(latest_ns, toNs(ANSWER_SHARE * between(latest_ns, state.deadline_ns))));
}

void OffloadEngine::Impl::startOverdue(uint64_t id, double frequency_ghz)
{
  if (open_requests == 0)
  {
    return;
  }
  const TaskState& added = tasks.at(id);
  const double run_s = local.seconds(added.task.kind) * options.computer.frequency_ghz / frequency_ghz;
  const double backlog_s = local.backlog(added.task.kind, now);
  const double need_s = localNeed(added.task.kind);
  // In the order in which they are due.
  std::vector<uint64_t> overdue;
  for (const auto& [at_ns, other_id] : timers)
  {
    const double left_s = between(now, at_ns);
    if (left_s > backlog_s + run_s)
    {
      break;
    }
    const TaskState& other = tasks.at(other_id);
    const bool waits = !other.local && !other.local_failed && answerable(other) && other.task.kind == added.task.kind;
    const bool nearly = left_s <= NEARLY_DUE * between(other.sent_ns, at_ns);
    const double before_s = backlog_s + static_cast<double>(overdue.size()) * run_s;
    const bool saves = before_s <= between(now, other.deadline_ns) - need_s;
    const bool spares = before_s + run_s + need_s <= between(now, added.deadline_ns);
    if (waits && nearly && saves && spares)
    {
      overdue.push_back(other_id);
    }
  }
  for (const uint64_t other_id : overdue)
  {
    if (tasks.count(other_id) != 0)
    {
      onTimer(other_id);
    }
  }
}

void OffloadEngine::Impl::startLocal(uint64_t id, double frequency_ghz, const char* reason)
{
  TaskState& state = tasks.at(id);
  const Task task = state.task;
  state.local = true;
  state.local_ghz = frequency_ghz;
  state.reason = reason;
  setHedge(state, NEVER_NS);
  setTimer(state, later(now, toNs(options.local_lost_s)));
  local.start(id, task.kind, frequency_ghz, now);
  bool failed = true;
  call(
      [&]
      {
        actions.run_local(task, frequency_ghz);
        failed = false;
      });
  if (failed)
  {
    localFailed(id, "the vehicle could not begin");
  }
}

void OffloadEngine::Impl::localFailed(uint64_t id, const char* reason)
{
  local.drop(id, now);
  const auto found = tasks.find(id);
  if (found == tasks.end() || !found->second.local)
  {
    return;
  }
  TaskState& state = found->second;
  state.local = false;
  state.local_failed = true;
  state.reason = reason;
  if (answerable(state) && state.deadline_ns > now)
  {
    setTimer(state, state.deadline_ns);
    return;
  }
  finish(id, Outcome::How::ABANDONED);
}

void OffloadEngine::Impl::setTimer(TaskState& state, int64_t at_ns)
{
  reschedule(&timers, &state.timer_ns, state.task.id, at_ns);
}

void OffloadEngine::Impl::setHedge(TaskState& state, int64_t at_ns)
{
  reschedule(&hedges, &state.hedge_ns, state.task.id, at_ns);
}

void OffloadEngine::Impl::hedge(uint64_t id)
{
  TaskState& state = tasks.at(id);
  setHedge(state, NEVER_NS);
  const auto first = requests.find(state.requests[0]);
  const NodeState* asked = first == requests.end() || !first->second.open ? nullptr : find(first->second.node);
  if (asked == nullptr || !enabled || open_requests >= options.max_in_flight)
  {
    return;
  }
  const Request& late = first->second;
  const Task& task = state.task;
  const double deadline_s = between(now, state.deadline_ns);
  fillInput(task.kind, task.input_bytes, deadline_s, static_cast<int>(asked->index), true, &input);
  const double passed_s = between(late.sent_ns, now);
  const AnswerTimes& times = asked->of_kind[static_cast<size_t>(task.kind)].times;
  const Hedge hedge = hedgeOf(input, options.policy, between(now, state.latest_ns),
                              [&](double after_s)
                              {
                                const double loss = options.policy.loss_share;
                                const Estimate& answer = late.answer_s;
                                return times.beyond((passed_s + after_s - answer.mean) / answer.deviation, loss) /
                                       times.beyond((passed_s - answer.mean) / answer.deviation, loss);
                              });
  if (hedge.node < 0 || hedge.energy_j > hedge_budget_j)
  {
    return;
  }
  hedge_budget_j -= hedge.energy_j;
  setTimer(state, later(now, toNs(hedge.fallback_s)));
  NodeState& node = *nodes[static_cast<size_t>(hedge.node)];
  const std::string name = node.description.id;
  Task copy = task;
  copy.deadline_s = usefulUntil(state);
  const int64_t uplink_before_ns = uplink_until_ns;
  const uint64_t number = openRequest(node, task);
  state.requests[1] = number;
  state.hedged = true;
  bool sent = false;
  call([&] { sent = actions.send(name, number, copy); });
  const auto found = requests.find(number);
  if (!sent && found != requests.end() && found->second.open)
  {
    uplink_until_ns = uplink_before_ns;
    requests.erase(found);
    --open_requests;
    if (NodeState* same = find(name))
    {
      forgetOwn(*same, number);
      --same->sent;
    }
    if (const auto open = tasks.find(id); open != tasks.end())
    {
      open->second.hedged = false;
    }
  }
}

void OffloadEngine::Impl::onTimer(uint64_t id)
{
  TaskState& state = tasks.at(id);
  setTimer(state, NEVER_NS);
  if (state.local)
  {
    localFailed(id, "the vehicle did not end it");
    return;
  }
  if (state.local_failed)
  {
    finish(id, Outcome::How::ABANDONED);
    return;
  }
  const auto request = requests.find(state.requests[0]);
  if (request != requests.end() && request->second.open)
  {
    if (NodeState* node = find(request->second.node))
    {
      node->estimates.addTimeout(state.task.kind, state.task.input_bytes, between(state.sent_ns, now), now);
      node->probe_soon = true;
      ++node->failures;
      node->suspended = node->suspended || node->failures >= options.max_failures;
    }
  }
  startLocal(id, options.computer.frequency_ghz, "no answer in time");
}

uint64_t OffloadEngine::Impl::openAt(const TaskState& state, uint64_t node) const
{
  for (const uint64_t number : state.requests)
  {
    const auto found = requests.find(number);
    if (found != requests.end() && found->second.open && (node == 0 || found->second.node == node))
    {
      return number;
    }
  }
  return 0;
}

bool OffloadEngine::Impl::answerable(const TaskState& state) const
{
  return openAt(state, 0) != 0;
}

double OffloadEngine::Impl::unansweredEnergy(const Request& request) const
{
  const double passed_s = std::max(0.0, between(request.sent_ns, now));
  const double input_mbit = static_cast<double>(request.bytes) * MBIT_PER_BYTE;
  const double sending_s = std::min(passed_s, input_mbit / request.rate_mbps);
  const Radio& radio = options.radio;
  return sending_s * radio.transmit_w + (passed_s - sending_s) * radio.wait_w + radio.tail_w * radio.tail_s;
}

void OffloadEngine::Impl::countAnswer(NodeState& node, Request* request)
{
  const double passed_s = between(request->sent_ns, now);
  const auto k = static_cast<size_t>(request->kind);
  for (AnswerTimes* of : {&node.of_kind[k].times, &times[k]})
  {
    const double value = (passed_s - request->answer_s.mean) / request->answer_s.deviation;
    request->open ? of->add(value) : of->addBeyond(value);
  }
  request->counted = true;
}

void OffloadEngine::Impl::closeRequest(TaskState& state, uint64_t number, bool tell_node)
{
  const auto found = requests.find(number);
  if (found == requests.end() || !found->second.open)
  {
    return;
  }
  Request& request = found->second;
  NodeState* node = find(request.node);
  state.radio_j += unansweredEnergy(request);
  request.open = false;
  if (node != nullptr)
  {
    forgetOwn(*node, number);
    countAnswer(*node, &request);
  }
  --open_requests;
  closed.emplace_back(later(now, toNs(LATE_S)), number);
  if (tell_node && node != nullptr && actions.cancel)
  {
    const std::string name = node->description.id;
    call([&] { actions.cancel(name, number); });
  }
}

void OffloadEngine::Impl::closeRequests(TaskState& state, bool tell_node)
{
  for (const uint64_t number : state.requests)
  {
    closeRequest(state, number, tell_node);
  }
}

void OffloadEngine::Impl::account(const TaskState& state, const Outcome& outcome)
{
  NodeState* node = find(state.first_node);
  if (node == nullptr || !(options.policy.lost_j > 0.0))
  {
    return;
  }
  const auto k = static_cast<size_t>(state.task.kind);
  const double vehicle_j = localCost(options.needs[k], options.computer).energy_j;
  const double miss_j = outcome.by_deadline ? 0.0 : missCost(options.policy, options.eta);
  NodeState::OfKind& of_kind = node->of_kind[k];
  // What was saved long ago counts no more, so that a node that became bad rests soon.
  of_kind.lost_j = ACCOUNT_KEPT * of_kind.lost_j + outcome.energy_j + miss_j - vehicle_j;
  if (of_kind.lost_j > options.policy.lost_j)
  {
    const double rest_s = FIRST_REST_S * std::pow(2.0, std::min(of_kind.rests++, MOST_REST_DOUBLINGS));
    of_kind.rests_until_ns = later(now, toNs(rest_s));
    of_kind.lost_j = 0.5 * options.policy.lost_j;
  }
  else if (of_kind.lost_j < -options.policy.lost_j)
  {
    of_kind.rests = 0;
  }
}

void OffloadEngine::Impl::forgetOwn(NodeState& node, uint64_t request)
{
  const auto same = [request](const NodeState::Own& own) { return own.request == request; };
  node.own.erase(std::remove_if(node.own.begin(), node.own.end(), same), node.own.end());
}

void OffloadEngine::Impl::finish(uint64_t id, Outcome::How how)
{
  // Removed first, so that the task ends once whatever the actions do.
  const auto found = tasks.find(id);
  TaskState state = std::move(found->second);
  tasks.erase(found);
  setTimer(state, NEVER_NS);
  setHedge(state, NEVER_NS);
  closeRequests(state, true);

  const auto k = static_cast<size_t>(state.task.kind);
  Outcome outcome;
  outcome.task = state.task;
  outcome.how = how;
  outcome.hedged = state.hedged;
  outcome.node = state.node;
  outcome.finished_ns = now;
  outcome.by_deadline = how != Outcome::How::ABANDONED && now <= state.deadline_ns;
  outcome.energy_j = state.radio_j;
  if (state.local_ghz > 0.0)
  {
    outcome.energy_j += localCost(options.needs[k], options.computer, state.local_ghz).energy_j;
  }
  outcome.reason = state.reason;
  outcome.expected_s = state.expected_s;
  outcome.expected_j = state.expected_j;
  outcome.expected_misses = state.expected_misses;

  Statistics::OfKind& of_kind = statistics.of_kind[k];
  of_kind.local += how == Outcome::How::LOCAL ? 1 : 0;
  of_kind.remote += how == Outcome::How::REMOTE ? 1 : 0;
  of_kind.fallback += how == Outcome::How::FALLBACK ? 1 : 0;
  of_kind.abandoned += how == Outcome::How::ABANDONED ? 1 : 0;
  of_kind.missed += outcome.by_deadline ? 0 : 1;
  of_kind.energy_j += outcome.energy_j;
  hedge_budget_j = std::min(MOST_HEDGES * state.radio_j, hedge_budget_j + options.policy.hedge_share * state.radio_j);
  account(state, outcome);
  call([&] { actions.deliver(outcome); });
}

void OffloadEngine::Impl::onTime()
{
  placeNodes(nodes.size());
  while (!hedges.empty() && hedges.begin()->first <= now)
  {
    hedge(hedges.begin()->second);
  }
  while (!timers.empty() && timers.begin()->first <= now)
  {
    onTimer(timers.begin()->second);
  }
  sendProbes();
  forgetOld();
}

void OffloadEngine::Impl::forgetOld()
{
  while (!closed.empty() && (closed.front().first <= now || closed.size() > MOST_CLOSED))
  {
    const auto request = requests.find(closed.front().second);
    closed.pop_front();
    if (request == requests.end())
    {
      continue;  // answered late
    }
    if (NodeState* node = find(request->second.node))
    {
      ++node->lost;
    }
    requests.erase(request);
  }
  if (tidied_ns == LONG_AGO_NS || now - tidied_ns >= toNs(TIDY_S))
  {
    // Runs on the vehicle whose end was never reported.
    local.dropOlder(later(now, -toNs(options.local_lost_s + TIDY_S)), now);
    tidied_ns = now;
  }
}

int64_t OffloadEngine::Impl::nextTime() const
{
  int64_t next = timers.empty() ? NEVER_NS : timers.begin()->first;
  next = hedges.empty() ? next : std::min(next, hedges.begin()->first);
  for (const std::unique_ptr<NodeState>& node : nodes)
  {
    next = std::min(next, probeDue(*node));
  }
  return std::max(next, now);
}

}  // namespace pi_offload
