#include "engine/engine_impl.h"

#include <algorithm>
#include <cmath>

namespace pi_offload
{
namespace
{
/// A node that refuses twice in a row pauses so long [s], then twice as long each time.
constexpr double FIRST_REFUSED_S = 0.1;
constexpr int MOST_DOUBLINGS = 4;
/// Of what is learned of the queue's forecast.
constexpr double ERROR_GAIN = 0.25;
}  // namespace

void OffloadEngine::Impl::fallBackAll(uint64_t key, const char* reason, bool keep_answerable, bool tell_node)
{
  std::vector<uint64_t> ids;
  for (const auto& [id, state] : tasks)
  {
    const auto request = requests.find(state.request);
    if (request != requests.end() && request->second.open && (key == 0 || request->second.node == key))
    {
      ids.push_back(id);
    }
  }
  std::sort(ids.begin(), ids.end());  // in the order of their ids, not of a hash table
  for (const uint64_t id : ids)
  {
    auto found = tasks.find(id);
    if (found == tasks.end())
    {
      continue;
    }
    closeRequest(found->second, keep_answerable, tell_node);
    found = tasks.find(id);
    if (found == tasks.end() || found->second.local)
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

bool OffloadEngine::Impl::onReply(const std::string& id, uint64_t number, const RequestTiming& timing,
                                  const NodeAdvertisement& advertisement)
{
  NodeState* node = find(id);
  const auto found = requests.find(number);
  const bool known = found != requests.end() && node != nullptr && found->second.node == node->key;
  if (node == nullptr)
  {
    return false;
  }
  heard(*node, advertisement);
  node->failures = 0;
  if (!known)
  {
    return false;
  }
  const Request request = found->second;
  const auto k = static_cast<size_t>(request.kind);
  RequestTiming measured = timing;
  measured.kind = request.kind;
  measured.input_bytes = request.bytes;
  if (!(measured.total_s > 0.0))
  {
    measured.total_s = std::max(0.0, between(request.sent_ns, now));
  }
  // The message waited for those before it: that says nothing of the rate.
  const double waited_s = between(request.sent_ns, uplink_seen_ns);
  const double node_s = std::max(0.0, measured.queue_s) + std::max(0.0, measured.service_s);
  if (waited_s > 0.0 && waited_s < measured.total_s - node_s)
  {
    measured.total_s -= waited_s;
  }
  node->estimates.add(measured, now);
  const double back_s = node_s + 0.5 * node->estimates.roundTrip().mean();
  if (std::isfinite(back_s) && back_s < between(request.sent_ns, now))
  {
    uplink_seen_ns = std::max(uplink_seen_ns, later(now, -toNs(back_s)));
    if (open_requests <= 1)
    {
      uplink_until_ns = std::min(uplink_until_ns, uplink_seen_ns);  // nothing else is under way
    }
  }
  NodeState::OfKind& of_kind = node->of_kind[k];
  of_kind.served_ns = now;
  of_kind.refusals = 0;
  countRefused(of_kind, false);
  of_kind.refused_until_ns = LONG_AGO_NS;
  if (measured.queue_s >= 0.0 && measured.queue_s <= measured.total_s)
  {
    const double beyond_s = measured.queue_s - request.expected_queue_s;
    if (request.expected_own_s > 0.0)
    {
      node->own_share += ERROR_GAIN * (std::clamp(beyond_s / request.expected_own_s, 0.0, 1.0) - node->own_share);
    }
    else
    {
      of_kind.queue_error_s += ERROR_GAIN * (std::abs(beyond_s) - of_kind.queue_error_s);
    }
  }
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
  state.request = 0;
  const double per_mbit = 1.0 / node->estimates.rate(now);
  const double output_mbit = measured.output_bytes > 0 ? static_cast<double>(measured.output_bytes) * MBIT_PER_BYTE
                                                       : options.needs[k].output_mbit;
  const double passed_s = std::max(0.0, between(request.sent_ns, now));
  const double sending_s = std::min(passed_s, static_cast<double>(request.bytes) * MBIT_PER_BYTE * per_mbit);
  const double receiving_s = std::min(passed_s - sending_s, output_mbit * per_mbit);
  const Radio& radio = options.radio;
  state.radio_j += sending_s * radio.transmit_w + receiving_s * radio.receive_w +
                   (passed_s - sending_s - receiving_s) * radio.wait_w + radio.tail_w * radio.tail_s;
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
  state.request = 0;
  state.radio_j += unansweredEnergy(state);
  if (state.local)
  {
    return;
  }
  if (state.local_failed)
  {
    finish(request.task, Outcome::How::ABANDONED);
    return;
  }
  setTimer(state, NEVER_NS);
  if (!state.retried)
  {
    state.retried = true;
    const Decision decision =
        decide(request.kind, state.task.input_bytes, between(now, state.deadline_ns), static_cast<int>(node->index));
    const int64_t fallback_ns =
        decision.node >= 0 ? fallbackTime(decision, state.task, state.deadline_ns) : LONG_AGO_NS;
    if (fallback_ns > now && sendTo(request.task, decision, fallback_ns))
    {
      return;
    }
  }
  startLocal(request.task, options.computer.frequency_ghz, "the node refused");
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
