// What OffloadClient sends and what comes back.

#include "client/client_impl.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace pi_offload
{
namespace
{

constexpr size_t MOST_REQUESTS = 8192;
constexpr int64_t FORGET_NS = 30LL * 1000000000;  ///< an older request is not answered any more
constexpr int64_t CHOOSE_NS = 500000000;          ///< between choices of links
constexpr char NOT_IN_RANGE[] = "not in range";
constexpr double AHEAD_S = 60.0;                  ///< nodes that come in range later need no connection
constexpr uint32_t CANCEL_ID = 1U << 30U;
constexpr uint32_t ID_MASK = CANCEL_ID - 1U;

/// A cancellation has another id than its request, because a request ends with the first reply to its id.
uint32_t idOf(const OffloadRequest& request)
{
  const auto id = static_cast<uint32_t>(request.request) & ID_MASK;
  return request.type == OffloadRequest::Type::CANCEL ? id | CANCEL_ID : id;
}

bool usable(const OffloadReply& reply)
{
  return std::isfinite(reply.confidence) && std::all_of(reply.objects.begin(), reply.objects.end(),
                                                        [](const DetectedObject& object)
                                                        {
                                                          return std::isfinite(object.score) &&
                                                                 std::isfinite(object.x1) && std::isfinite(object.y1) &&
                                                                 std::isfinite(object.x2) && std::isfinite(object.y2);
                                                        });
}

}  // namespace

void OffloadClient::Impl::setAddress(const std::string& node, const std::string& address)
{
  NodeState& state = nodes[node];
  if (state.address != address)
  {
    state.requester.reset();
    state.address = address;
    state.status.up = false;
    state.status.problem = NOT_IN_RANGE;
  }
}

void OffloadClient::Impl::chooseLinks(int64_t now_ns)
{
  choose_links_ns = now_ns + CHOOSE_NS;
  struct Candidate
  {
    double wait_s;  ///< until it is in range
    bool connected;
    std::string id;
  };
  std::vector<Candidate> candidates;
  for (const OffloadEngine::NodeStatus& node : client.engine_.nodes(now_ns))
  {
    const double wait_s = node.in_range ? 0.0 : node.residence.window_s() > 0.0 ? node.residence.enters_s : AHEAD_S;
    if (wait_s < AHEAD_S)
    {
      const auto& id = node.description.id;
      candidates.push_back({wait_s, nodes[id].requester != nullptr, id});
    }
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b)
            { return std::tie(a.wait_s, b.connected, a.id) < std::tie(b.wait_s, a.connected, b.id); });
  candidates.resize(std::min(candidates.size(), client.options_.max_connections));
  for (auto& [id, state] : nodes)
  {
    const bool wanted = std::any_of(candidates.begin(), candidates.end(),
                                    [id = id](const Candidate& candidate) { return candidate.id == id; });
    if (wanted && !state.requester)
    {
      connect(id, state);
    }
    else if (!wanted && state.requester)
    {
      state.requester.reset();
      state.connection = 0;
      onLink(id, state, false, "");
      state.status.problem = NOT_IN_RANGE;
    }
  }
}

std::unique_ptr<Requester> OffloadClient::Impl::makeRequester(const std::string& address,
                                                              Requester::Callbacks callbacks) const
{
  const OffloadClientOptions& options = client.options_;
  if (options.transport == Transport::DIRECT)
  {
    SpRequester::Options link = options.link;
    link.address = address;
    return std::make_unique<SpRequester>(link, std::move(callbacks));
  }
  NatsRequester::Options link;
  link.vehicle = options.vehicle;
  link.network = options.network;
  link.connection.nats = options.nats;
  link.connection.nats.servers = {address};
  link.connection.name = options.vehicle;
  link.connection.connect_timeout_s = options.link.connect_timeout_s;
  link.connection.reconnect_s = options.link.reconnect_s;
  link.connection.max_reconnect_s = options.link.max_reconnect_s;
  link.connection.max_queued_bytes = options.link.max_queued_bytes;
  link.connection.only_these = true;
  return std::make_unique<NatsRequester>(link, std::move(callbacks));
}

void OffloadClient::Impl::connect(const std::string& node, NodeState& state)
{
  state.status.up = false;
  state.unanswered_since_ns = 0;
  state.connection = ++last_connection;
  const auto post = [this, node, connection = state.connection](auto function)
  {
    client.thread_.post(
        [this, node, connection, function = std::move(function)](int64_t)
        {
          const auto found = nodes.find(node);
          if (found != nodes.end() && found->second.connection == connection)
          {
            function(found->second);
          }
        });
  };
  Requester::Callbacks callbacks;
  callbacks.reply = [this, post, node](uint32_t, std::vector<uint8_t> body, int64_t received_ns)
  {
    try
    {
      const auto reply = std::make_shared<const OffloadReply>(decodeReply(body.data(), body.size()));
      post(
          [this, node, reply, received_ns](NodeState& from)
          {
            from.unanswered_since_ns = 0;
            onReply(node, *reply, received_ns);
          });
    }
    catch (const WireError& error)
    {
      post([this, text = "node " + node + ": an answer is damaged: " + error.what()](NodeState&)
           { client.callbacks_.log(true, text); });
    }
  };
  callbacks.link = [this, post, node](bool up, const std::string& reason)
  { post([this, node, up, reason](NodeState& of) { onLink(node, of, up, reason); }); };
  callbacks.unserved = [this, post, node](uint32_t id)
  {
    post(
        [this, node, id, received_ns = pi_node::monotonicNs()](NodeState& from)
        {
          from.unanswered_since_ns = 0;
          onUnserved(node, id, received_ns);
        });
  };
  callbacks.problem = [this, post, node](const std::string& text)
  { post([this, text = "node " + node + ": " + text](NodeState&) { client.callbacks_.log(true, text); }); };
  state.status.problem.clear();
  state.requester = makeRequester(state.address, std::move(callbacks));
}

bool OffloadClient::Impl::send(const std::string& node, const OffloadRequest& request, int64_t now_ns)
{
  const auto found = nodes.find(node);
  if (found == nodes.end() || !found->second.status.up)
  {
    return false;
  }
  NodeState& to = found->second;
  if (to.unanswered_since_ns != 0 && pi_node::seconds(now_ns - to.unanswered_since_ns) > client.options_.unanswered_s)
  {
    // Data queued for a silent node would delay all that follows.
    to.unanswered_since_ns = 0;
    to.requester->reconnect("no answer for too long");
    return false;
  }
  if (!to.requester->send(idOf(request), pi_offload::encode(request)))
  {
    return false;
  }
  if (to.unanswered_since_ns == 0 && request.type != OffloadRequest::Type::CANCEL)
  {
    to.unanswered_since_ns = now_ns;
  }
  return true;
}

PictureEncoder::Situation OffloadClient::Impl::situation(const std::string& node, const Task& task,
                                                         int64_t now_ns) const
{
  const EngineOptions& options = client.options_.engine;
  const size_t kind = static_cast<size_t>(task.kind);
  PictureEncoder::Situation situation;
  const auto found = nodes.find(node);
  situation.rate_mbps = found != nodes.end() ? found->second.transfer.rate(now_ns) : options.estimates.first_rate_mbps;
  situation.deadline_s = task.deadline_s > 0.0 ? task.deadline_s : options.needs[kind].deadline_s;
  situation.eta = eta;
  situation.local_energy_j = localCost(options.needs[kind], options.computer).energy_j;
  const double f_ghz = options.computer.frequency_ghz;
  situation.busy_w = options.computer.static_w + options.computer.beta_w_per_ghz3 * f_ghz * f_ghz * f_ghz;
  situation.transmit_w = options.radio.transmit_w;
  return situation;
}

OffloadRequest OffloadClient::Impl::requestFor(const std::string& node, OffloadRequest::Type type, uint64_t number,
                                               int64_t now_ns) const
{
  OffloadRequest request;
  request.type = type;
  request.request = number;
  request.vehicle = client.options_.vehicle;
  request.sent_ns = now_ns;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    request.lease_rate_hz[kind] =
        client.enabled_ ? client.engine_.leaseRate(node, static_cast<TaskKind>(kind), now_ns) : 0.0;
  }
  return request;
}

bool OffloadClient::Impl::sendTask(const std::string& node, uint64_t number, const Task& task)
{
  const auto state = tasks.find(task.id);
  const auto to = nodes.find(node);
  if (state == tasks.end() || to == nodes.end() || !to->second.status.up || !to->second.requester->connected())
  {
    return false;
  }
  const int64_t now_ns = pi_node::monotonicNs();
  requests[number] = Request{node, task.id, task.kind, now_ns, task.deadline_s, 0, 0};
  const std::shared_ptr<const TaskData> data = state->second.data;
  const bool begun = state->second.payload
                         ? transmit(number, state->second)
                         : encode(number, data, client.encoder_->choose(data->picture, situation(node, task, now_ns)));
  if (!begun)
  {
    requests.erase(number);
  }
  return begun;
}

/// On the encode thread; onEncoded() gets the result. @return false if too many pictures wait.
bool OffloadClient::Impl::encode(uint64_t number, const std::shared_ptr<const TaskData>& data, Encoding encoding)
{
  if (pictures_waiting >= client.options_.max_encoding)
  {
    return false;
  }
  ++pictures_waiting;
  encode_thread.post(
      [this, number, data, encoding](int64_t)
      {
        --pictures_waiting;
        std::vector<uint8_t> bytes;
        std::string problem;
        try
        {
          encode_stage.run([&] { bytes = client.encoder_->encode(data->picture, encoding); });
        }
        catch (const std::exception& error)
        {
          problem = error.what();
        }
        client.thread_.post([this, number, encoding, bytes = std::move(bytes), problem](int64_t) mutable
                            { onEncoded(number, encoding, std::move(bytes), problem); });
      });
  return true;
}

bool OffloadClient::Impl::transmit(uint64_t number, const TaskState& state)
{
  Request& request = requests.at(number);
  const int64_t now_ns = pi_node::monotonicNs();
  OffloadRequest message = requestFor(request.node, OffloadRequest::Type::TASK, number, now_ns);
  message.kind = state.task.kind;
  message.remaining_s = std::max(0.0, request.deadline_s - pi_node::seconds(now_ns - state.task.created_ns));
  message.encoding = state.encoding;
  message.width = static_cast<uint32_t>(state.data->picture.width);
  message.height = static_cast<uint32_t>(state.data->picture.height);
  message.options = state.data->options;
  message.speech_s = state.data->speech_s;
  message.payload = *state.payload;
  request.sent_ns = now_ns;
  request.bytes = message.payload.size();
  return send(request.node, message, now_ns);
}

void OffloadClient::Impl::onEncoded(uint64_t number, Encoding encoding, std::vector<uint8_t> bytes,
                                    const std::string& problem)
{
  const auto request = requests.find(number);
  if (request == requests.end())
  {
    return;  // called back meanwhile
  }
  const std::string node = request->second.node;
  const auto task = tasks.find(*request->second.task);
  if (task == tasks.end())
  {
    requests.erase(request);
    return;
  }
  if (!problem.empty())
  {
    client.callbacks_.log(true, "a picture cannot be sent: " + problem);
    requests.erase(request);
    client.engine_.onRefused(node, number, nullptr, pi_node::monotonicNs());
    return;
  }
  task->second.encoding = encoding;
  task->second.payload = std::make_shared<const std::vector<uint8_t>>(std::move(bytes));
  if (!transmit(number, task->second))
  {
    requests.erase(number);
    client.engine_.onRefused(node, number, nullptr, pi_node::monotonicNs());
  }
}

bool OffloadClient::Impl::sendProbe(const std::string& node, uint64_t number)
{
  const int64_t now_ns = pi_node::monotonicNs();
  if (!send(node, requestFor(node, OffloadRequest::Type::PROBE, number, now_ns), now_ns))
  {
    return false;
  }
  requests[number] = Request{node, std::nullopt, TaskKind::DETECTION, now_ns, 0.0, now_ns, 0};
  return true;
}

void OffloadClient::Impl::cancel(const std::string& node, uint64_t number)
{
  const auto request = requests.find(number);
  if (request == requests.end())
  {
    return;
  }
  if (request->second.sent_ns == 0)
  {
    requests.erase(request);
    return;
  }
  const int64_t now_ns = pi_node::monotonicNs();
  OffloadRequest message = requestFor(node, OffloadRequest::Type::CANCEL, number, now_ns);
  message.kind = request->second.kind;
  send(node, message, now_ns);  // if it is not sent, the node only works in vain
}

void OffloadClient::Impl::deliver(const Outcome& outcome)
{
  const OffloadReply* const reply = result != nullptr && result_task == outcome.task.id ? result : nullptr;
  tasks.erase(outcome.task.id);
  client.callbacks_.deliver(outcome, reply);
}

// ------------------------------------------------------------------------------------------------------------- events

NodeAdvertisement OffloadClient::Impl::corrected(const std::string& node, const OffloadReply& reply)
{
  NodeAdvertisement advertisement = reply.advertisement;
  NodeState& state = nodes[node];
  if (!reply.model.empty())
  {
    state.status.model = reply.model;
  }
  // With NATS another site's worker may have answered.
  advertisement.has_position = advertisement.has_position && client.options_.transport == Transport::DIRECT;
  if (!classes_known)
  {
    advertisement.of_kind[static_cast<size_t>(TaskKind::DETECTION)].served = false;
  }
  return advertisement;
}

void OffloadClient::Impl::onReply(const std::string& node, const OffloadReply& reply, int64_t received_ns)
{
  const auto found = requests.find(reply.request);
  if (nodes.count(node) == 0)
  {
    return;
  }
  if (found == requests.end() || found->second.node != node)
  {
    nodes[node].status.unasked += reply.type == OffloadRequest::Type::CANCEL ? 0 : 1;
    return;
  }
  const Request request = found->second;
  requests.erase(found);
  // received_ns may be older than the engine's time.
  const int64_t now_ns = pi_node::monotonicNs();
  const double total_s = pi_node::seconds(received_ns - request.begun_ns);
  if (!request.task)
  {
    nodes[node].transfer.addRoundTrip(total_s, now_ns);
    client.engine_.onProbeReply(node, reply.request, total_s, corrected(node, reply), now_ns);
    return;
  }
  const NodeAdvertisement advertisement = corrected(node, reply);
  const bool done = reply.status == OffloadReply::Status::OK && reply.type == OffloadRequest::Type::TASK;
  const bool unknown_classes = request.kind == TaskKind::DETECTION && !classes_known;
  if (!done || unknown_classes || !usable(reply))
  {
    if (reply.status == OffloadReply::Status::FAILED)
    {
      client.callbacks_.log(false, "node " + node + " failed on " + toString(request.kind) + ": " + reply.text);
    }
    else if (done && !unknown_classes)
    {
      client.callbacks_.log(true, "node " + node + ": an answer has numbers that are not finite");
    }
    client.engine_.onRefused(node, reply.request, &advertisement, now_ns);
    return;
  }
  RequestTiming timing;
  timing.kind = request.kind;
  timing.input_bytes = request.bytes;
  timing.output_bytes = 32 * reply.objects.size() + reply.text.size();
  timing.total_s = pi_node::seconds(received_ns - request.sent_ns);
  timing.queue_s = reply.queue_s;
  timing.service_s = reply.service_s;
  nodes[node].transfer.add(timing, now_ns);
  timing.total_s = total_s;  // the engine also counts the encoding
  result = &reply;
  result_task = *request.task;
  try
  {
    client.engine_.onReply(node, reply.request, timing, advertisement, now_ns);
  }
  catch (...)
  {
    result = nullptr;
    throw;
  }
  result = nullptr;
}

void OffloadClient::Impl::onUnserved(const std::string& node, uint32_t id, int64_t received_ns)
{
  const auto request =
      std::find_if(requests.begin(), requests.end(),
                   [&](const auto& entry) { return (entry.first & ID_MASK) == id && entry.second.node == node; });
  if (request == requests.end())
  {
    return;  // a cancellation
  }
  OffloadReply nobody;  // serves nothing
  nobody.status = OffloadReply::Status::REFUSED;
  nobody.request = request->first;
  onReply(node, nobody, received_ns);
}

void OffloadClient::Impl::onLink(const std::string& node, NodeState& state, bool up, const std::string& reason)
{
  const int64_t now_ns = pi_node::monotonicNs();
  state.status.up = up;
  state.status.problem = up ? "" : reason;
  state.unanswered_since_ns = 0;
  state.transfer.forgetNetwork();
  if (up)
  {
    state.told.clear();
    state.status.model.clear();
    client.engine_.onLinkUp(node, now_ns);
    return;
  }
  if (!reason.empty() && state.told != reason)  // once, not with each attempt
  {
    state.told = reason;
    client.callbacks_.log(false, "node " + node + ": not connected: " + reason);
  }
  for (auto request = requests.begin(); request != requests.end();)
  {
    request = request->second.node == node ? requests.erase(request) : std::next(request);
  }
  client.engine_.onLinkDown(node, now_ns);
}

void OffloadClient::Impl::forgetOld(int64_t now_ns)
{
  while (!requests.empty() &&
         (requests.size() > MOST_REQUESTS || now_ns - requests.begin()->second.begun_ns > FORGET_NS))
  {
    requests.erase(requests.begin());
  }
}

}  // namespace pi_offload
