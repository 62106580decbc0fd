#include "engine/engine_impl.h"

#include <algorithm>
#include <cmath>

namespace pi_offload
{
namespace
{
/// Pause after two refusals in a row [s]; doubles with each further one.
constexpr double FIRST_REFUSED_S = 0.1;
constexpr int MOST_DOUBLINGS = 4;
/// Gain of the corrections of the queue's forecast.
constexpr double ERROR_GAIN = 0.25;
}  // namespace

void OffloadEngine::Impl::fallBackAll(uint64_t key, const char* reason, bool keep_answerable, bool tell_node)
{
  std::vector<uint64_t> ids;
  for (const auto& [id, state] : tasks)
  {
    if (openAt(state, key) != 0)
    {
      ids.push_back(id);
    }
  }
  std::sort(ids.begin(), ids.end());  // a defined order
  for (const uint64_t id : ids)
  {
    auto found = tasks.find(id);
    if (found == tasks.end())
    {
      continue;
    }
    uint64_t request = openAt(found->second, key);
    for (; request != 0 && !keep_answerable; request = openAt(found->second, key))
    {
      closeRequest(found->second, request, tell_node);
    }
    if (NodeState* node = request == 0 ? nullptr : find(requests.at(request).node))
    {
      forgetOwn(*node, request);
    }
    found = tasks.find(id);
    const uint64_t other = found == tasks.end() ? 0 : openAt(found->second, 0);
    const bool awaited = key != 0 && other != 0 && requests.at(other).node != key;
    if (found == tasks.end() || found->second.local || awaited)
    {
      continue;
    }
    if (!found->second.local_failed)
    {
      startLocal(id, options.computer.frequency_ghz, reason);
    }
    else if (!keep_answerable)
    {
      finish(id, Outcome::How::ABANDONED);
    }
  }
}

/// Learns from a node's answer. @return the times of the request, as they count.
RequestTiming OffloadEngine::Impl::learn(NodeState& node, const Request& request, const RequestTiming& timing)
{
  RequestTiming measured = timing;
  measured.kind = request.kind;
  measured.input_bytes = request.bytes;
  const double passed_s = between(request.sent_ns, now);
  if (!(measured.total_s > 0.0))
  {
    measured.total_s = std::max(0.0, passed_s);
  }
  // The time behind earlier messages of this vehicle says nothing about the rate.
  const double waited_s = between(request.sent_ns, uplink_seen_ns);
  const double node_s = std::max(0.0, measured.queue_s) + std::max(0.0, measured.service_s);
  if (waited_s > 0.0 && waited_s < measured.total_s - node_s)
  {
    measured.total_s -= waited_s;
  }
  node.estimates.add(measured, now);
  const double back_s = node_s + 0.5 * node.estimates.roundTrip().mean();
  if (std::isfinite(back_s) && back_s < passed_s)
  {
    uplink_seen_ns = std::max(uplink_seen_ns, later(now, -toNs(back_s)));
    if (open_requests <= 1)
    {
      uplink_until_ns = std::min(uplink_until_ns, uplink_seen_ns);  // nothing else is under way
    }
  }
  NodeState::OfKind& of_kind = node.of_kind[static_cast<size_t>(request.kind)];
  of_kind.served_ns = now;
  of_kind.refusals = 0;
  countRefused(of_kind, false);
  of_kind.refused_until_ns = LONG_AGO_NS;
  if (measured.queue_s >= 0.0 && measured.queue_s <= measured.total_s)
  {
    const double beyond_s = measured.queue_s - request.expected_queue_s;
    if (request.expected_own_s > 0.0)
    {
      node.own_share += ERROR_GAIN * (std::clamp(beyond_s / request.expected_own_s, 0.0, 1.0) - node.own_share);
    }
    else
    {
      of_kind.queue_error_s += ERROR_GAIN * (std::abs(beyond_s) - of_kind.queue_error_s);
    }
  }
  return measured;
}

/// Energy of the radio for an answered request [J].
double OffloadEngine::Impl::answeredEnergy(const NodeState& node, const Request& request, size_t output_bytes) const
{
  const double per_mbit = 1.0 / node.estimates.rate(now);
  const double output_mbit = output_bytes > 0 ? static_cast<double>(output_bytes) * MBIT_PER_BYTE
                                              : options.needs[static_cast<size_t>(request.kind)].output_mbit;
  const double passed_s = std::max(0.0, between(request.sent_ns, now));
  const double sending_s = std::min(passed_s, static_cast<double>(request.bytes) * MBIT_PER_BYTE * per_mbit);
  const double receiving_s = std::min(passed_s - sending_s, output_mbit * per_mbit);
  const Radio& radio = options.radio;
  return sending_s * radio.transmit_w + receiving_s * radio.receive_w +
         (passed_s - sending_s - receiving_s) * radio.wait_w + radio.tail_w * radio.tail_s;
}

bool OffloadEngine::Impl::onReply(const std::string& id, uint64_t number, const RequestTiming& timing,
                                  const NodeAdvertisement& advertisement)
{
  NodeState* node = find(id);
  if (node == nullptr)
  {
    return false;
  }
  heard(*node, advertisement);
  node->failures = 0;
  const auto found = requests.find(number);
  if (found == requests.end() || found->second.node != node->key)
  {
    return false;
  }
  if (!found->second.counted)
  {
    countAnswer(*node, &found->second);
  }
  const Request request = found->second;
  const RequestTiming measured = learn(*node, request, timing);
  forgetOwn(*node, number);
  requests.erase(found);
  if (!request.open)
  {
    ++node->late;
    return false;
  }
  --open_requests;
  ++node->answered;
  TaskState& state = tasks.at(request.task);
  state.node = id;
  const double radio_j = answeredEnergy(*node, request, measured.output_bytes);
  state.radio_j += radio_j;
  finish(request.task, Outcome::How::REMOTE);
  return true;
}

void OffloadEngine::Impl::onRefused(const std::string& id, uint64_t number, const NodeAdvertisement* advertisement)
{
  NodeState* node = find(id);
  if (node == nullptr)
  {
    return;
  }
  if (advertisement != nullptr)
  {
    heard(*node, *advertisement);
    node->failures = 0;
  }
  const auto found = requests.find(number);
  if (found == requests.end() || found->second.node != node->key)
  {
    return;
  }
  const Request request = found->second;
  NodeState::OfKind& of_kind = node->of_kind[static_cast<size_t>(request.kind)];
  ++node->refused;
  countRefused(of_kind, true);
  if (++of_kind.refusals >= 2)
  {
    const double pause_s = FIRST_REFUSED_S * std::pow(2.0, std::min(of_kind.refusals - 2, MOST_DOUBLINGS));
    of_kind.refused_until_ns = later(now, toNs(pause_s));
  }
  forgetOwn(*node, number);
  requests.erase(found);
  if (!request.open)
  {
    return;
  }
  --open_requests;
  TaskState& state = tasks.at(request.task);
  state.radio_j += unansweredEnergy(request);
  if (state.local || openAt(state, 0) != 0)
  {
    return;
  }
  if (state.local_failed)
  {
    finish(request.task, Outcome::How::ABANDONED);
    return;
  }
  setTimer(state, NEVER_NS);
  setHedge(state, NEVER_NS);
  if (!sendElsewhere(state, static_cast<int>(node->index)))
  {
    startLocal(request.task, options.computer.frequency_ghz, "the node refused");
  }
}

/// Once per task. @return false if no other node took it.
bool OffloadEngine::Impl::sendElsewhere(TaskState& state, int refused)
{
  if (std::exchange(state.retried, true))
  {
    return false;
  }
  const Task task = state.task;
  const int64_t deadline_ns = state.deadline_ns;
  const Decision decision = decide(task.kind, task.input_bytes, between(now, deadline_ns), refused);
  const int64_t fallback_ns = decision.node >= 0 ? fallbackTime(decision, task, deadline_ns) : LONG_AGO_NS;
  return fallback_ns > now && sendTo(task.id, decision, fallback_ns);
}

bool OffloadEngine::Impl::onLocalDone(uint64_t id, double work_s)
{
  local.done(id, work_s, now);
  const auto found = tasks.find(id);
  if (found == tasks.end() || !found->second.local)
  {
    return false;
  }
  finish(id, found->second.node.empty() ? Outcome::How::LOCAL : Outcome::How::FALLBACK);
  return true;
}

void OffloadEngine::Impl::setEnabled(bool on)
{
  enabled = on;
  if (!on)
  {
    fallBackAll(0, "offloading was switched off", false, true);
  }
}

}  // namespace pi_offload
