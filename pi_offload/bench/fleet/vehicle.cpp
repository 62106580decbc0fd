#include <pi_node/durations.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "vehicle.h"
#include "wire/socket_tools.h"

namespace pi_offload_bench
{

using namespace pi_offload;

namespace
{

/// Servers that get no tasks are asked so often how they are, as an OffloadEngine does.
constexpr int64_t PROBE_NS = 200000000;
/// An answer that has not come so long after the deadline will not be waited for.
constexpr int64_t LOST_NS = 2000000000;
/// Text of a server that gives a task back.
constexpr char GIVES_BACK[] = "no worker will be free in time any more";

std::string nameOf(size_t number)
{
  return "vehicle_" + std::to_string(number);
}

}  // namespace

Vehicle::Vehicle(size_t number, const FleetOptions& options, const FleetInputs& inputs, int64_t begin_ns,
                 int64_t end_ns)
  : options_(options)
  , inputs_(inputs)
  , begin_ns_(begin_ns)
  , end_ns_(end_ns)
  , name_(nameOf(number))
  , servers_(options.servers.size())
  , current_(number % options.servers.size())
{
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    served_ns_[kind] = begin_ns;
    tally_[kind].served = {0};
    tally_[kind].longest_pause_s = {0.0};
  }
  if (options.engine)
  {
    makeEngine();
  }
  for (size_t i = 0; i < servers_.size(); ++i)
  {
    servers_[i].id = "server_" + std::to_string(i);
    if (engine_)
    {
      NodeDescription node;
      node.id = servers_[i].id;
      node.address = options.servers[i];
      node.range_m = std::numeric_limits<double>::infinity();
      engine_->setNode(node, pi_node::monotonicNs());
    }
  }
  const std::lock_guard<std::mutex> lock(mutex_);  // callbacks wait until all is there
  for (size_t i = 0; i < servers_.size(); ++i)
  {
    SpRequester::Options link;
    link.address = options.servers[i];
    SpRequester::Callbacks on;
    on.reply = [this, i](uint32_t id, std::vector<uint8_t> body, int64_t received_ns)
    { onReply(i, id, body, received_ns); };
    on.link = [this, i](bool up, const std::string&) { onLink(i, up); };
    servers_[i].link = std::make_unique<SpRequester>(link, on);
  }
}

Vehicle::~Vehicle()
{
  for (Server& server : servers_)
  {
    server.link.reset();
  }
}

void Vehicle::makeEngine()
{
  EngineOptions options;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    options.needs[kind].deadline_s = options_.deadline_s[kind];
  }
  OffloadEngine::Actions actions;
  actions.send = [this](const std::string& node, uint64_t request, const Task& task)
  { return sendTask(serverOf(node), request, task.id, task.deadline_s); };
  actions.probe = [this](const std::string& node, uint64_t request)
  {
    const size_t server = serverOf(node);
    return send(server, requestOf(server, OffloadRequest::Type::PROBE, request), 0);
  };
  actions.cancel = [this](const std::string& node, uint64_t request)
  {
    const size_t server = serverOf(node);
    send(server, requestOf(server, OffloadRequest::Type::CANCEL, request), 0);
  };
  actions.run_local = [this](const Task& task, double)
  {
    const int64_t now_ns = pi_node::monotonicNs();
    const int64_t begin_ns = local_.empty() ? now_ns : std::max(now_ns, local_.back().done_ns);
    local_.push_back({task.id, begin_ns + pi_node::nanoseconds(options_.local_s)});
  };
  actions.deliver = [this](const Outcome& outcome)
  {
    const size_t kind = static_cast<size_t>(outcome.task.kind);
    const auto task = tasks_.find(outcome.task.id);
    tally_[kind].missed += counts(task->second) && !outcome.by_deadline ? 1U : 0U;
    End end = End::FAILED;
    switch (outcome.how)
    {
      case Outcome::How::LOCAL:
        end = End::KEPT;
        break;
      case Outcome::How::REMOTE:
        end = outcome.by_deadline ? End::IN_TIME : End::LATE;
        break;
      case Outcome::How::FALLBACK:
        end = std::strcmp(outcome.reason, "the node refused") == 0    ? End::REFUSED
              : std::strcmp(outcome.reason, "no answer in time") == 0 ? End::LATE
                                                                      : End::FAILED;
        break;
      case Outcome::How::ABANDONED:
        break;
    }
    endTask(outcome.task.id, end, outcome.finished_ns);
  };
  engine_ = std::make_unique<OffloadEngine>(options, actions);
}

size_t Vehicle::serverOf(const std::string& id) const
{
  return static_cast<size_t>(
      std::find_if(servers_.begin(), servers_.end(), [&](const Server& server) { return server.id == id; }) -
      servers_.begin());
}

OffloadRequest Vehicle::requestOf(size_t server, OffloadRequest::Type type, uint64_t number) const
{
  OffloadRequest request;
  request.type = type;
  request.request = number;
  request.vehicle = name_;
  request.sent_ns = pi_node::monotonicNs();
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    request.lease_rate_hz[kind] =
        engine_ ? engine_->leaseRate(servers_[server].id, static_cast<TaskKind>(kind), request.sent_ns)
                : (server == current_ ? options_.rate_hz[kind] : 0.0);
  }
  return request;
}

bool Vehicle::send(size_t server, OffloadRequest request, uint64_t task)
{
  Server& to = servers_[server];
  const uint32_t id = next_id_++;
  to.asked_ns = request.sent_ns;
  // Beforehand: the answer may be there before send() returns.
  requests_[id] = Request{server, request.request, task, request.sent_ns, request.payload.size()};
  if (!to.link->send(id, encode(request)))
  {
    requests_.erase(id);
    return false;
  }
  return true;
}

bool Vehicle::sendTask(size_t server, uint64_t number, uint64_t task, double deadline_s)
{
  const TaskState& state = tasks_.at(task);
  OffloadRequest request = requestOf(server, OffloadRequest::Type::TASK, number);
  request.kind = state.kind;
  request.remaining_s = std::max(0.0, deadline_s - pi_node::secondsBetween(state.created_ns, request.sent_ns));
  const bool picture = state.kind == TaskKind::DETECTION;
  request.encoding = picture ? Encoding::JPEG : Encoding::S16LE;
  request.payload = picture ? inputs_.pictures[state.picture] : inputs_.sound;
  return send(server, std::move(request), task);
}

/// The current one, unless another's is shorter by a task.
size_t Vehicle::shorterQueue(TaskKind kind) const
{
  const auto queue = [&](size_t server) { return servers_[server].said.of_kind[static_cast<size_t>(kind)].queue_s; };
  size_t best = current_;
  for (size_t i = 0; i < servers_.size(); ++i)
  {
    const double margin_s = servers_[i].said.of_kind[static_cast<size_t>(kind)].service_s;
    if (servers_[i].up && (!servers_[best].up || queue(i) + margin_s < queue(best)))
    {
      best = i;
    }
  }
  return best;
}

void Vehicle::create(TaskKind kind, int64_t now_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  const uint64_t number = next_task_++;
  TaskState& state = tasks_[number];
  state.kind = kind;
  state.created_ns = now_ns;
  state.picture = static_cast<size_t>(number) % inputs_.pictures.size();
  if (engine_)
  {
    Task task;
    task.id = number;
    task.kind = kind;
    task.created_ns = now_ns;
    task.input_bytes = kind == TaskKind::DETECTION ? inputs_.pictures[state.picture].size() : inputs_.sound.size();
    engine_->submit(task, now_ns);
    return;
  }
  if (kind == TaskKind::DETECTION)
  {
    current_ = shorterQueue(kind);
  }
  ask(number, current_);
}

void Vehicle::ask(uint64_t task, size_t server)
{
  TaskState& state = tasks_.at(task);
  ++state.asked;
  if (!sendTask(server, next_number_++, task, options_.deadline_s[static_cast<size_t>(state.kind)]))
  {
    endTask(task, End::FAILED, pi_node::monotonicNs());
  }
}

void Vehicle::onTime(int64_t now_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  while (!local_.empty() && local_.front().done_ns <= now_ns)
  {
    const uint64_t task = local_.front().task;
    local_.pop_front();
    engine_->onLocalDone(task, options_.local_s, now_ns);
  }
  if (engine_)
  {
    if (engine_->nextTime() <= now_ns)
    {
      engine_->onTime(now_ns);
    }
    return;
  }
  for (size_t i = 0; i < servers_.size(); ++i)
  {
    if (servers_[i].up && now_ns - servers_[i].asked_ns >= PROBE_NS)
    {
      send(i, requestOf(i, OffloadRequest::Type::PROBE, next_number_++), 0);
    }
  }
  std::vector<uint64_t> lost;
  for (const auto& task : tasks_)
  {
    const double deadline_s = options_.deadline_s[static_cast<size_t>(task.second.kind)];
    if (now_ns - task.second.created_ns > pi_node::nanoseconds(deadline_s) + LOST_NS)
    {
      lost.push_back(task.first);
    }
  }
  for (const uint64_t task : lost)
  {
    endTask(task, End::LATE, now_ns);
  }
}

bool Vehicle::busy() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::any_of(tasks_.begin(), tasks_.end(), [&](const auto& task) { return counts(task.second); });
}

std::array<FleetTally, TASK_KINDS> Vehicle::tally() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  std::array<FleetTally, TASK_KINDS> complete = tally_;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    double& longest_s = complete[kind].longest_pause_s.front();
    longest_s = std::max(longest_s, pi_node::secondsBetween(served_ns_[kind], end_ns_));
  }
  return complete;
}

void Vehicle::onReply(size_t server, uint32_t id, const std::vector<uint8_t>& body, int64_t received_ns)
{
  const OffloadReply reply = decodeReply(body.data(), body.size());
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = requests_.find(id);
  if (found == requests_.end())
  {
    return;
  }
  const Request request = found->second;
  requests_.erase(found);
  servers_[server].said = reply.advertisement;
  if (engine_)
  {
    onEngineAnswer(request, reply, received_ns);
  }
  else if (request.task != 0)
  {
    onAnswer(request, reply, received_ns);
  }
}

void Vehicle::onAnswer(const Request& request, const OffloadReply& reply, int64_t received_ns)
{
  const auto found = tasks_.find(request.task);
  if (found == tasks_.end())
  {
    return;  // it was not waited for any more
  }
  const TaskState& task = found->second;
  const size_t kind = static_cast<size_t>(task.kind);
  const double left_s = options_.deadline_s[kind] - pi_node::secondsBetween(task.created_ns, received_ns);
  switch (reply.status)
  {
    case OffloadReply::Status::OK:
      endTask(request.task, left_s >= 0.0 ? End::IN_TIME : End::LATE, received_ns);
      return;
    case OffloadReply::Status::EXPIRED:
      endTask(request.task, End::LATE, received_ns);
      return;
    case OffloadReply::Status::FAILED:
      endTask(request.task, End::FAILED, received_ns);
      return;
    case OffloadReply::Status::REFUSED:
      break;
  }
  const size_t other = (request.server + 1) % servers_.size();
  const NodeAdvertisement::OfKind& said = servers_[other].said.of_kind[kind];
  if (task.asked < servers_.size() && servers_[other].up && said.queue_s + said.service_s < left_s)
  {
    ask(request.task, other);
    return;
  }
  endTask(request.task, reply.text == GIVES_BACK ? End::GIVEN_BACK : End::REFUSED, received_ns);
}

void Vehicle::onEngineAnswer(const Request& request, const OffloadReply& reply, int64_t received_ns)
{
  const std::string& node = servers_[request.server].id;
  const int64_t now_ns = pi_node::monotonicNs();
  const double total_s = pi_node::secondsBetween(request.sent_ns, received_ns);
  if (reply.type == OffloadRequest::Type::PROBE)
  {
    engine_->onProbeReply(node, request.number, total_s, reply.advertisement, now_ns);
  }
  else if (reply.type == OffloadRequest::Type::TASK && reply.status == OffloadReply::Status::OK)
  {
    RequestTiming timing;
    timing.kind = reply.kind;
    timing.input_bytes = request.bytes;
    timing.output_bytes = 32 * reply.objects.size() + reply.text.size();
    timing.total_s = total_s;
    timing.queue_s = reply.queue_s;
    timing.service_s = reply.service_s;
    engine_->onReply(node, request.number, timing, reply.advertisement, now_ns);
  }
  else if (reply.type == OffloadRequest::Type::TASK)
  {
    engine_->onRefused(node, request.number, &reply.advertisement, now_ns);
  }
}

void Vehicle::onLink(size_t server, bool up)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  servers_[server].up = up;
  const int64_t now_ns = pi_node::monotonicNs();
  if (engine_)
  {
    up ? engine_->onLinkUp(servers_[server].id, now_ns) : engine_->onLinkDown(servers_[server].id, now_ns);
  }
}

void Vehicle::endTask(uint64_t task, End end, int64_t now_ns)
{
  const auto found = tasks_.find(task);
  const TaskState state = found->second;
  tasks_.erase(found);
  if (!counts(state))
  {
    return;
  }
  FleetTally& tally = tally_[static_cast<size_t>(state.kind)];
  const double passed_s = pi_node::secondsBetween(state.created_ns, now_ns);
  ++tally.tasks;
  switch (end)
  {
    case End::IN_TIME:
    {
      ++tally.in_time;
      ++tally.served.front();
      tally.answer_s.push_back(passed_s);
      int64_t& served_ns = served_ns_[static_cast<size_t>(state.kind)];
      tally.longest_pause_s.front() =
          std::max(tally.longest_pause_s.front(), pi_node::secondsBetween(served_ns, now_ns));
      served_ns = now_ns;
      break;
    }
    case End::REFUSED:
      ++tally.refused;
      tally.refusal_s.push_back(passed_s);
      break;
    case End::GIVEN_BACK:
      ++tally.given_back;
      tally.given_back_s.push_back(passed_s);
      break;
    case End::KEPT:
      ++tally.kept;
      break;
    case End::LATE:
      ++tally.late;
      break;
    case End::FAILED:
      ++tally.failed;
      break;
  }
}

}  // namespace pi_offload_bench
