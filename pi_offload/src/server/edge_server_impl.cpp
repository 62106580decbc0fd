// What EdgeServer does with requests.

#include "server/edge_server_impl.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <optional>

#include "wire/nats_socket.h"
#include "wire/socket_tools.h"

namespace pi_offload
{
namespace
{

/// A connection with more vehicles is closed.
constexpr size_t MAX_VEHICLES_PER_CONNECTION = 64;

}  // namespace

void EdgeServer::Impl::log(const std::string& text) const
{
  if (callbacks.event)
  {
    callbacks.event(text);
  }
}

/// Under the mutex.
OffloadReply EdgeServer::Impl::replyTo(const OffloadRequest& request, OffloadReply::Status status, int64_t now_ns) const
{
  OffloadReply reply;
  reply.status = status;
  reply.type = request.type;
  reply.request = request.request;
  reply.kind = request.kind;
  reply.model = options.model;
  reply.advertisement = admission.advertisement(request.vehicle, now_ns);
  reply.advertisement.has_position = options.has_position;
  reply.advertisement.position = options.position;
  reply.advertisement.range_m = options.range_m;
  return reply;
}

std::unique_ptr<Replier> EdgeServer::Impl::makeReplier()
{
  Replier::Callbacks on;
  on.request = [this](const Replier::Peer& peer, const std::vector<uint8_t>& body, int64_t received_ns)
  { onRequest(peer, body, received_ns); };
  on.closed = [this](uint64_t connection, const std::string&) { onClosed(connection); };
  on.problem = [this](const std::string& text) { log(text); };
  on.status = [this] { return status(); };
  if (options.transport == Transport::DIRECT)
  {
    return std::make_unique<SpReplier>(options.replier, on);
  }
  NatsReplier::Options nats;
  nats.nats = options.nats;
  nats.site = options.site;
  nats.idle_timeout_s = options.replier.idle_timeout_s;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    if (options.admission.served[kind])
    {
      const auto of = static_cast<TaskKind>(kind);
      nats.subjects.push_back(natsSubject(of, of == TaskKind::SPEECH ? SPEECH_NETWORK : options.network));
    }
  }
  return std::make_unique<NatsReplier>(nats, on);
}

/// As the reply to a probe of nobody; `text` is the address of the site's server.
std::vector<uint8_t> EdgeServer::Impl::status() const
{
  const std::lock_guard<std::mutex> lock(mutex);
  OffloadReply reply = replyTo(OffloadRequest(), OffloadReply::Status::OK, pi_node::monotonicNs());
  reply.text = options.address;
  return encode(reply);
}

/// Releases the lock while it sends.
void EdgeServer::Impl::send(std::unique_lock<std::mutex>* lock, Outgoing out)
{
  if (out.empty())
  {
    return;
  }
  ++sending;
  lock->unlock();
  uint64_t lost = 0;
  for (const auto& entry : out)
  {
    try
    {
      lost += replier->reply(entry.first, encode(entry.second)) ? 0U : 1U;
    }
    catch (const std::exception& error)
    {
      ++lost;
      log("a reply to " + entry.first.address + " cannot be sent: " + error.what());
    }
  }
  lock->lock();
  counted.unanswered += lost;
  --sending;
  work_done.notify_all();
}

/// Under the mutex.
void EdgeServer::Impl::eraseJob(uint64_t ticket)
{
  const auto found = jobs.find(ticket);
  if (found != jobs.end())
  {
    const Job& job = found->second;
    payload_bytes -= job.payload_bytes;
    tickets.erase(Key(job.peer.connection, job.request.vehicle, job.request.request));
    jobs.erase(found);
  }
}

/// Under the mutex.
void EdgeServer::Impl::answerExpired(int64_t now_ns, Outgoing* out)
{
  for (const ServerTask& task : admission.takeExpired())
  {
    const auto found = jobs.find(task.ticket);
    if (found == jobs.end())
    {
      continue;
    }
    const Job& job = found->second;
    const bool over = now_ns >= job.deadline_ns;
    OffloadReply reply =
        replyTo(job.request, over ? OffloadReply::Status::EXPIRED : OffloadReply::Status::REFUSED, now_ns);
    reply.text = over ? "the time was over before a worker was free" : "no worker will be free in time any more";
    reply.queue_s = std::max(0.0, pi_node::secondsBetween(job.received_ns, now_ns));
    out->emplace_back(job.peer, std::move(reply));
    eraseJob(task.ticket);
  }
}

void EdgeServer::Impl::onRequest(const Replier::Peer& peer, const std::vector<uint8_t>& body, int64_t received_ns)
{
  OffloadRequest request;
  try
  {
    request = decodeRequest(body.data(), body.size());
  }
  catch (const WireError& error)
  {
    log(peer.address + ": " + error.what());
    const std::lock_guard<std::mutex> lock(mutex);
    ++counted.malformed;
    if (!stop)
    {
      replier->close(peer.connection, error.what());
    }
    return;
  }
  if (!peer.vehicle.empty() && peer.vehicle != request.vehicle)
  {
    const std::lock_guard<std::mutex> lock(mutex);
    ++counted.malformed;
    log(peer.vehicle + " calls itself " + request.vehicle + " in a request");
    return;
  }
  Outgoing out;
  std::unique_lock<std::mutex> lock(mutex);
  if (stop)
  {
    return;
  }
  const int64_t now_ns = pi_node::monotonicNs();
  Link& link = links[peer.connection];
  if (link.vehicles.count(request.vehicle) == 0 && link.vehicles.size() >= MAX_VEHICLES_PER_CONNECTION)
  {
    ++counted.malformed;
    replier->close(peer.connection, "too many vehicles on one connection");
    return;
  }
  link.vehicles.insert(request.vehicle);
  connection_of[request.vehicle] = peer.connection;
  const double excess_s = link.delay.excess(request.sent_ns, received_ns);
  if (request.type != OffloadRequest::Type::CANCEL)
  {
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      admission.lease(request.vehicle, static_cast<TaskKind>(kind), request.lease_rate_hz[kind], now_ns);
    }
  }
  switch (request.type)
  {
    case OffloadRequest::Type::PROBE:
      ++counted.probes;
      out.emplace_back(peer, replyTo(request, OffloadReply::Status::OK, now_ns));
      break;
    case OffloadRequest::Type::TASK:
      onTask(peer, std::move(request), excess_s, now_ns, &out);
      break;
    case OffloadRequest::Type::CANCEL:
    {
      const std::string done = onCancel(peer, request);
      out.emplace_back(peer, replyTo(request, OffloadReply::Status::OK, now_ns));
      out.back().second.text = done;
      break;
    }
  }
  answerExpired(now_ns, &out);
  work_wanted.notify_one();
  send(&lock, std::move(out));
}

/// Under the mutex.
void EdgeServer::Impl::onTask(const Replier::Peer& peer, OffloadRequest request, double excess_s, int64_t now_ns,
                              Outgoing* out)
{
  const Key key(peer.connection, request.vehicle, request.request);
  const auto known = tickets.find(key);
  if (known != tickets.end())
  {
    ++counted.repeated;
    Job& job = jobs.at(known->second);
    job.peer = peer;
    job.cancelled = false;
    return;
  }
  const auto refuse = [&](const std::string& text)
  {
    out->emplace_back(peer, replyTo(request, OffloadReply::Status::REFUSED, now_ns));
    out->back().second.text = text;
  };
  const size_t bytes = request.payload.size() + request.options.size();
  if (payload_bytes + bytes > options.max_payload_bytes)
  {
    refuse("no memory: tasks of " + std::to_string(payload_bytes) + " bytes are being done, at most " +
           std::to_string(options.max_payload_bytes) + " are taken");
    return;
  }
  ServerTask task;
  task.ticket = next_ticket++;
  task.vehicle = request.vehicle;
  task.kind = request.kind;
  task.arrived_ns = now_ns;
  task.remaining_s = request.remaining_s - excess_s;
  const Admission::Verdict verdict = admission.submit(task);
  if (verdict != Admission::Verdict::TAKEN)
  {
    refuse(Admission::toString(verdict));
    return;
  }
  Job job;
  job.peer = peer;
  job.received_ns = now_ns;
  job.deadline_ns = now_ns + static_cast<int64_t>(std::min(task.remaining_s, 86400.0) * 1e9);
  job.payload_bytes = bytes;
  job.request = std::move(request);
  payload_bytes += bytes;
  jobs.emplace(task.ticket, std::move(job));
  tickets.emplace(key, task.ticket);
}

/// Under the mutex. @return text for the reply.
std::string EdgeServer::Impl::onCancel(const Replier::Peer& peer, const OffloadRequest& request)
{
  const auto found = tickets.find(Key(peer.connection, request.vehicle, request.request));
  if (found == tickets.end())
  {
    return "not known";
  }
  const uint64_t ticket = found->second;
  ++counted.cancelled;
  if (admission.cancel(ticket))
  {
    eraseJob(ticket);
    work_done.notify_all();
    return "cancelled";
  }
  jobs.at(ticket).cancelled = true;
  return "it runs: its result is thrown away";
}

void EdgeServer::Impl::onClosed(uint64_t connection)
{
  const std::lock_guard<std::mutex> lock(mutex);
  const auto link = links.find(connection);
  if (link == links.end())
  {
    return;
  }
  for (const std::string& vehicle : link->second.vehicles)
  {
    const auto current = connection_of.find(vehicle);
    if (current == connection_of.end() || current->second != connection)
    {
      continue;  // it has another one by now
    }
    connection_of.erase(current);
    admission.forgetVehicle(vehicle);
  }
  // Tasks that wait cannot be answered any more, also those of vehicles with another connection.
  std::vector<uint64_t> gone;
  for (const auto& job : jobs)
  {
    if (job.second.peer.connection == connection && !job.second.running)
    {
      gone.push_back(job.first);
    }
  }
  for (const uint64_t ticket : gone)
  {
    admission.cancel(ticket);
    eraseJob(ticket);
  }
  links.erase(link);
  work_done.notify_all();
}

OffloadReply EdgeServer::Impl::execute(Worker* worker, const OffloadRequest& request, double* service_s)
{
  OffloadReply failure;
  failure.status = OffloadReply::Status::FAILED;
  try
  {
    OffloadReply reply = worker->executors[static_cast<size_t>(request.kind)](request, service_s);
    encode(reply);  // throws for a result that cannot be sent
    return reply;
  }
  catch (const std::exception& error)
  {
    failure.text = error.what();
  }
  catch (...)
  {
    failure.text = "the task failed without saying why";
  }
  return failure;
}

void EdgeServer::Impl::work(Worker* worker)
{
  std::unique_lock<std::mutex> lock(mutex);
  while (!stop)
  {
    const int64_t begin_ns = pi_node::monotonicNs();
    const std::optional<ServerTask> task = admission.next(begin_ns);
    Outgoing out;
    answerExpired(begin_ns, &out);
    if (!task)
    {
      if (out.empty())
      {
        work_wanted.wait(lock);
      }
      send(&lock, std::move(out));
      continue;
    }
    Job& job = jobs.at(task->ticket);
    job.running = true;
    worker->busy = true;
    worker->busy_since_ns = begin_ns;
    // A running job stays in the map; only its peer may change.
    const OffloadRequest& request = job.request;
    send(&lock, std::move(out));
    lock.unlock();
    double service_s = -1.0;
    OffloadReply result = execute(worker, request, &service_s);
    if (!(service_s >= 0.0 && std::isfinite(service_s)))
    {
      service_s = pi_node::secondsBetween(begin_ns, pi_node::monotonicNs());
    }
    const bool done = result.status == OffloadReply::Status::OK;
    if (!done)
    {
      log(std::string(toString(request.kind)) + " for " + request.vehicle + " failed: " + result.text);
    }
    lock.lock();
    worker->busy = false;
    const int64_t end_ns = pi_node::monotonicNs();
    admission.finished(task->ticket, done ? service_s : -1.0, end_ns);
    Statistics::OfKind& of_kind = counted.of_kind[static_cast<size_t>(task->kind)];
    ++(done ? of_kind.done : of_kind.failed);
    OffloadReply reply = replyTo(request, result.status, end_ns);
    reply.queue_s = std::max(0.0, pi_node::secondsBetween(job.received_ns, begin_ns));
    reply.service_s = service_s;
    durations[static_cast<size_t>(task->kind)].waiting.Observe(reply.queue_s);
    durations[static_cast<size_t>(task->kind)].service.Observe(service_s);
    reply.text = std::move(result.text);
    reply.objects = std::move(result.objects);
    if (!result.model.empty())
    {
      reply.model = std::move(result.model);
    }
    reply.confidence = result.confidence;
    reply.accepted = result.accepted;
    Outgoing answer;
    if (!job.cancelled)
    {
      answer.emplace_back(job.peer, std::move(reply));
    }
    eraseJob(task->ticket);
    work_done.notify_all();
    send(&lock, std::move(answer));
  }
}

}  // namespace pi_offload
