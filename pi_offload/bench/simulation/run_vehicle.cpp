// Run: what vehicles do.

#include "simulation/run.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace pi_offload::simulation
{
namespace
{

constexpr double ROUTE_PERIOD_S = 1.0;

}  // namespace

void Run::updateVehicle(Vehicle* vehicle, size_t v)
{
  vehicle->engine->setVehicle(world_.vehicle(v, now_ns_));
  if (vehicle->route_set_ns < 0 || now_ns_ - vehicle->route_set_ns >= toNs(ROUTE_PERIOD_S))
  {
    vehicle->route_set_ns = now_ns_;
    vehicle->engine->setRoute(world_.routeAhead(v, now_ns_));
  }
}

void Run::wakeEngine(size_t v)
{
  Vehicle& vehicle = vehicles_[v];
  const int64_t next_ns = vehicle.engine->nextTime();
  if (next_ns < vehicle.engine_event_ns)
  {
    vehicle.engine_event_ns = std::max(next_ns, now_ns_);
    push(vehicle.engine_event_ns, Event::Type::ENGINE, v, 0, 0);
  }
}

void Run::onTask(size_t v, const Task& task)
{
  Vehicle& vehicle = vehicles_[v];
  vehicle.open[task.id].task = &task;
  ++result_.of_kind[static_cast<size_t>(task.kind)].tasks;
  if (vehicle.engine == nullptr)
  {
    informed_ ? askInformed(v, task, -1) : askOracle(v, task);
    return;
  }
  updateVehicle(&vehicle, v);
  vehicle.engine->submit(task, now_ns_);
  wakeEngine(v);
}

/// The lease that the vehicle asks for. The oracle asks for its full rate of tasks.
double Run::leaseRate(size_t v, size_t node, TaskKind kind) const
{
  const Vehicle& vehicle = vehicles_[v];
  return vehicle.engine == nullptr ? scenario_.stream(kind)->rate_hz
                                   : vehicle.engine->leaseRate(scenario_.nodes[node].description.id, kind, now_ns_);
}

/// The node knows the delay of a message; see OneWayDelay.
Arrival Run::arrivalOf(size_t v, size_t node, const Task& task, uint64_t ticket, int64_t arrives_ns) const
{
  Arrival arrival;
  arrival.task.ticket = ticket;
  arrival.task.vehicle = vehicles_[v].name;
  arrival.task.kind = task.kind;
  arrival.task.arrived_ns = arrives_ns;
  arrival.task.remaining_s = toS(task.created_ns + toNs(task.deadline_s) - arrives_ns);
  arrival.service_s = world_.service_s(node, task);
  arrival.lease_hz = leaseRate(v, node, task.kind);
  return arrival;
}

bool Run::sendTask(size_t v, size_t node, uint64_t id, const Task& task)
{
  Vehicle& vehicle = vehicles_[v];
  if (!vehicle.link_up[node])
  {
    return false;
  }
  const uint64_t ticket = ++last_ticket_;
  Request& request = requests_[ticket];
  request.vehicle = static_cast<uint32_t>(v);
  request.node = static_cast<uint32_t>(node);
  request.request = id;
  request.task = task;
  request.sent_ns = now_ns_;
  request.output_bytes = scenario_.stream(task.kind)->output_bytes;
  vehicle.open[task.id].tickets.push_back(ticket);
  vehicle.ticket_of[id] = ticket;

  const Radio& radio = scenario_.engine.radio;
  const int64_t deadline_ns = task.created_ns + toNs(task.deadline_s);
  const int64_t begin_ns = std::max(now_ns_, vehicle.radio_free_ns);
  const double rate_mbps = world_.rate_mbps(v, node, begin_ns);
  if (rate_mbps <= 0.0)
  {
    vehicle.radio_j += radio.transmit_w * std::max(0.0, toS(deadline_ns - now_ns_));
    return true;
  }
  if (begin_ns >= deadline_ns)
  {
    return true;
  }
  const double transfer_s = megabits(task.input_bytes) / rate_mbps;
  request.sent_out_ns = begin_ns + toNs(transfer_s);
  vehicle.radio_free_ns = request.sent_out_ns;
  vehicle.radio_j += radio.transmit_w * transfer_s + radio.tail_w * radio.tail_s;
  const int64_t arrives_ns = request.sent_out_ns + toNs(world_.uplink_latency_s(v, node, task.id));
  request.arrival = arrivalOf(v, node, task, ticket, arrives_ns);
  if (vehicle.engine == nullptr)
  {
    pending_[node].push_back({arrives_ns, request.arrival});
  }
  push(arrives_ns, Event::Type::ARRIVAL, v, node, ticket);
  return true;
}

/// Probes do not wait for large messages; their energy is that of their own transfer.
bool Run::sendProbe(size_t v, size_t node, uint64_t id)
{
  Vehicle& vehicle = vehicles_[v];
  if (!vehicle.link_up[node])
  {
    return false;
  }
  const double rate_mbps = world_.rate_mbps(v, node, now_ns_);
  if (rate_mbps <= 0.0)
  {
    return true;
  }
  const double transfer_s = megabits(SMALL_MESSAGE_BYTES) / rate_mbps;
  vehicle.radio_j += scenario_.engine.radio.transmit_w * transfer_s;
  const uint64_t ticket = ++last_ticket_;
  Request& request = requests_[ticket];
  request.vehicle = static_cast<uint32_t>(v);
  request.node = static_cast<uint32_t>(node);
  request.request = id;
  request.probe = true;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    request.lease_hz[kind] = leaseRate(v, node, static_cast<TaskKind>(kind));
  }
  request.sent_ns = now_ns_;
  request.output_bytes = SMALL_MESSAGE_BYTES;
  const uint64_t key = PROBE_KEY | static_cast<uint64_t>(now_ns_);
  push(now_ns_ + toNs(transfer_s + world_.uplink_latency_s(v, node, key)), Event::Type::PROBE_ARRIVAL, v, node, ticket);
  return true;
}

void Run::sendCancel(size_t v, size_t node, uint64_t id)
{
  const auto found = vehicles_[v].ticket_of.find(id);
  if (found != vehicles_[v].ticket_of.end() && vehicles_[v].link_up[node] && world_.rate_mbps(v, node, now_ns_) > 0.0)
  {
    const uint64_t key = PROBE_KEY | static_cast<uint64_t>(now_ns_);
    push(now_ns_ + toNs(world_.uplink_latency_s(v, node, key)), Event::Type::CANCEL, v, node, found->second);
  }
}

void Run::runLocal(size_t v, const Task& task, double frequency_ghz)
{
  Vehicle& vehicle = vehicles_[v];
  const auto kind = static_cast<size_t>(task.kind);
  const Scenario::Stream& stream = *scenario_.stream(task.kind);
  const LocalComputer& computer = scenario_.engine.computer;
  const double frequency = frequency_ghz > 0.0 ? frequency_ghz : computer.frequency_ghz;
  const double highest_s = world_.local_s(task);
  const auto joules_per_cycle = [&](double f)
  { return (computer.static_w + computer.beta_w_per_ghz3 * f * f * f) / f; };
  const double energy_j = stream.local_j * highest_s / stream.local_s * joules_per_cycle(frequency) /
                          joules_per_cycle(computer.frequency_ghz);
  Work work;
  work.vehicle = static_cast<uint32_t>(v);
  work.task = task;
  work.work_s = highest_s * computer.frequency_ghz / frequency;
  const auto open = vehicle.open.find(task.id);
  const bool fallback = open == vehicle.open.end() || !open->second.tickets.empty();
  if (open != vehicle.open.end())
  {
    open->second.local = true;
  }
  (fallback ? vehicle.fallback_j : vehicle.local_j) += energy_j;
  int64_t& free_ns = vehicle.processor_free_ns[kind];
  free_ns = std::max(free_ns, now_ns_) + toNs(work.work_s);
  works_[++last_work_] = work;
  push(free_ns, Event::Type::LOCAL_DONE, v, 0, last_work_);
}

void Run::onLocalDone(uint64_t id)
{
  const Work work = std::move(works_.at(id));
  works_.erase(id);
  Vehicle& vehicle = vehicles_[work.vehicle];
  if (vehicle.engine != nullptr)
  {
    vehicle.engine->onLocalDone(work.task.id, work.work_s, now_ns_);
    wakeEngine(work.vehicle);
    return;
  }
  const auto open = vehicle.open.find(work.task.id);
  if (open != vehicle.open.end())
  {
    Outcome outcome;
    outcome.task = work.task;
    outcome.how = open->second.tickets.empty() ? Outcome::How::LOCAL : Outcome::How::FALLBACK;
    outcome.finished_ns = now_ns_;
    onOutcome(work.vehicle, outcome);
  }
}

/// The radio waits from the last sent bit to the answer or the end of the task.
void Run::stopWaiting(const Request& request)
{
  if (request.sent_out_ns < now_ns_)
  {
    const double waited_s = toS(now_ns_ - request.sent_out_ns) - request.receiving_s;
    vehicles_[request.vehicle].radio_j += scenario_.engine.radio.wait_w * std::max(0.0, waited_s);
  }
}

void Run::forget(uint64_t ticket)
{
  const auto found = requests_.find(ticket);
  vehicles_[found->second.vehicle].ticket_of.erase(found->second.request);
  requests_.erase(found);
}

void Run::onOutcome(size_t v, const Outcome& outcome)
{
  Vehicle& vehicle = vehicles_[v];
  const auto open = vehicle.open.find(outcome.task.id);
  if (open == vehicle.open.end())
  {
    throw std::logic_error("task " + std::to_string(outcome.task.id) + " ended twice");
  }
  const auto kind = static_cast<size_t>(outcome.task.kind);
  SimulationResult::OfKind& of = result_.of_kind[kind];
  const bool ended = outcome.how != Outcome::How::ABANDONED;
  const double time_s = ended ? toS(now_ns_ - outcome.task.created_ns) : HUGE_VAL;
  const bool in_time = time_s <= outcome.task.deadline_s;
  times_s_[kind].push_back(time_s);
  of.missed += in_time ? 0 : 1;
  of.local += outcome.how == Outcome::How::LOCAL ? 1 : 0;
  of.remote += outcome.how == Outcome::How::REMOTE ? 1 : 0;
  of.remote_late += outcome.how == Outcome::How::REMOTE && !in_time ? 1 : 0;
  of.fallback += outcome.how == Outcome::How::FALLBACK ? 1 : 0;
  if (outcome.how == Outcome::How::REMOTE && in_time)
  {
    ++vehicle.served;
  }
  if (outcome.how == Outcome::How::FALLBACK)
  {
    ++result_.fallback_reasons[outcome.reason];
  }
  if (!in_time)
  {
    const char* how = outcome.how == Outcome::How::REMOTE  ? "late answer"
                      : outcome.how == Outcome::How::LOCAL ? "late on the vehicle"
                                                           : outcome.reason;
    ++result_.miss_reasons[how];
  }
  bool answered = open->second.tickets.empty();
  for (const uint64_t ticket : open->second.tickets)
  {
    const auto request = requests_.find(ticket);
    if (request == requests_.end())
    {
      answered = true;  // refused, or dropped
      continue;
    }
    request->second.task_ended = true;
    if (request->second.answered)
    {
      answered = true;
      forget(ticket);
    }
    else
    {
      stopWaiting(request->second);
    }
  }
  result_.timeouts += answered ? 0 : 1;
  vehicle.open.erase(open);
  --tasks_left_;
}

void Run::onReply(uint64_t ticket)
{
  const auto found = requests_.find(ticket);
  Request& request = found->second;
  const size_t v = request.vehicle;
  Vehicle& vehicle = vehicles_[v];
  const std::string& node = scenario_.nodes[request.node].description.id;
  vehicle.radio_j += scenario_.engine.radio.receive_w * request.receiving_s;
  if (request.probe)
  {
    if (vehicle.link_up[request.node])
    {
      const double round_trip_s = toS(now_ns_ - request.sent_ns);
      vehicle.engine->onProbeReply(node, request.request, round_trip_s, request.advertisement, now_ns_);
      wakeEngine(v);
    }
    requests_.erase(found);
    return;
  }
  if (!request.task_ended)
  {
    stopWaiting(request);
  }
  request.answered = true;
  const Request reply = request;  // the outcome erases it
  const bool done = reply.state == Request::State::DONE;
  result_.refused += reply.state == Request::State::REFUSED ? 1 : 0;
  result_.expired += reply.state == Request::State::EXPIRED ? 1 : 0;
  if (reply.task_ended || !done)
  {
    forget(ticket);
  }
  if (vehicle.engine != nullptr && !vehicle.link_up[reply.node])
  {
    return;
  }
  if (vehicle.engine != nullptr && done)
  {
    RequestTiming timing;
    timing.kind = reply.task.kind;
    timing.input_bytes = reply.task.input_bytes;
    timing.output_bytes = reply.output_bytes;
    timing.total_s = toS(now_ns_ - reply.sent_ns);
    timing.queue_s = reply.queue_s;
    timing.service_s = reply.service_s;
    vehicle.engine->onReply(node, reply.request, timing, reply.advertisement, now_ns_);
    wakeEngine(v);
  }
  else if (vehicle.engine != nullptr)
  {
    vehicle.engine->onRefused(node, reply.request, &reply.advertisement, now_ns_);
    wakeEngine(v);
  }
  else if (done && vehicle.open.count(reply.task.id) != 0)
  {
    Outcome outcome;
    outcome.task = reply.task;
    outcome.how = Outcome::How::REMOTE;
    outcome.finished_ns = now_ns_;
    onOutcome(v, outcome);
  }
  else if (!done && informed_ && vehicle.open.count(reply.task.id) != 0 && !vehicle.open.at(reply.task.id).local)
  {
    vehicle.open.at(reply.task.id).tickets.clear();
    askInformed(v, reply.task, static_cast<int>(reply.node));
  }
  else if (!done && !informed_)
  {
    runLocal(v, reply.task, 0.0);
  }
}

}  // namespace pi_offload::simulation
