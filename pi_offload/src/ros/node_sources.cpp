#include "ros/node_sources.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <exception>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/node_file.h"
#include "ros/conversions.h"
#include "wire/nats_socket.h"

namespace pi_offload
{
namespace
{

constexpr size_t MOST_WAITING = 256;

}  // namespace

NodeSources::NodeSources(ros::NodeHandle node, const CoordinatorRosOptions* options, OffloadClient* client,
                         AnswerCheck* checks, MapFrame* map, pi_node::WarningBoard* warnings)
  : options_(options), client_(client), checks_(checks), map_(map), warnings_(warnings)
{
  load();
  if (options_->announcements)
  {
    announcements_ =
        node.subscribe("edge_nodes", 256, &NodeSources::onEdgeNode, this, ros::TransportHints().tcpNoDelay());
  }
  if (options_->client.transport == Transport::NATS && !options_->client.nats.servers.empty())
  {
    NatsConnection::Options directory;
    directory.nats = options_->client.nats;
    directory.name = "sites";
    NatsConnection::Callbacks on;
    on.message = [this](const NatsConnection::Message& message) { onStatus(message); };
    on.problem = [this](const std::string& text) { warnings_->warn("nats/servers: " + text); };
    on.link = [problem = on.problem](bool up, const std::string& reason)
    { up ? void() : problem("not connected: " + reason); };
    directory_ = std::make_unique<NatsConnection>(
        directory, std::vector<NatsConnection::Subscription>{{std::string(STATUS_SUBJECT) + "*"}}, std::move(on));
  }
}

/// As EdgeServer::Impl::status() made it. The position is one in the vehicle's map, as in replies.
void NodeSources::onStatus(const NatsConnection::Message& message)
{
  const OffloadReply status = decodeReply(message.body.data(), message.body.size());
  NodeDescription node;
  node.id = message.subject.substr(sizeof STATUS_SUBJECT - 1);
  node.address = status.text;
  node.network = status.model;
  node.position = status.advertisement.position;
  node.range_m =
      status.advertisement.has_position ? status.advertisement.range_m : std::numeric_limits<double>::infinity();
  NodeDescription& known = sites_[node.id];
  const auto fields = [](const NodeDescription& of)
  { return std::tie(of.address, of.network, of.position.x, of.position.y, of.range_m); };
  if (fields(known) != fields(node))
  {
    known = node;
    client_->post(
        [this, node](int64_t now_ns)
        {
          std::string problem;
          addToEngine(node, &problem, now_ns);
          if (!problem.empty())
          {
            warnings_->warn("nats/servers: " + problem);
          }
        });
  }
}

void NodeSources::load()
{
  std::vector<NodeDescription> nodes = options_->nodes;
  if (!options_->nodes_file.empty())
  {
    const std::vector<NodeDescription> of_file = loadNodeFile(options_->nodes_file);
    nodes.insert(nodes.begin(), of_file.begin(), of_file.end());
    try
    {
      requireUniqueIds(nodes);
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument(options_->nodes_file + " and parameter nodes: " + error.what());
    }
  }
  if (nodes.size() > options_->max_nodes)
  {
    throw std::invalid_argument(options_->nodes_file + ": there are " + std::to_string(nodes.size()) +
                                " nodes, must be at most max_nodes = " + std::to_string(options_->max_nodes));
  }
  for (const NodeDescription& node : nodes)
  {
    client_->setNode(node, pi_node::monotonicNs());
  }
}

void NodeSources::watch()
{
  for (auto waiting = waiting_.begin(); waiting != waiting_.end();)
  {
    std::string problem;
    const bool known = add(waiting->second, &problem);
    if (!problem.empty())
    {
      warnings_->warn(problem);
    }
    waiting = known ? waiting_.erase(waiting) : std::next(waiting);
  }
}

bool NodeSources::add(const EdgeNode& message, std::string* problem)
{
  problem->clear();
  try
  {
    NodeDescription node = fromMsg(message);
    std::string missing;
    const auto transform = map_->from(message.frame_id, &missing);
    if (!transform)
    {
      *problem = missing.empty() ? "" : "node " + node.id + ": " + missing;
      return false;
    }
    const Eigen::Vector3d p_map = *transform * Eigen::Vector3d(node.position.x, node.position.y, 0.0);
    node.position = {p_map.x(), p_map.y()};
    client_->call([this, &node, problem](int64_t now_ns) { addToEngine(node, problem, now_ns); });
  }
  catch (const std::exception& error)
  {
    *problem = error.what();
  }
  return true;
}

void NodeSources::addToEngine(const NodeDescription& node, std::string* problem, int64_t now_ns)
{
  const std::vector<OffloadEngine::NodeStatus> nodes = client_->engine().nodes(now_ns);
  const bool is_new =
      std::none_of(nodes.begin(), nodes.end(), [&node](const auto& other) { return other.description.id == node.id; });
  if (is_new && nodes.size() >= options_->max_nodes)
  {
    *problem = "node " + node.id + " is one too many: max_nodes = " + std::to_string(options_->max_nodes);
    return;
  }
  client_->setNode(node, now_ns);
}

void NodeSources::onEdgeNode(const EdgeNodeConstPtr& message)
{
  std::string problem;
  if (!add(*message, &problem) && waiting_.size() < MOST_WAITING)
  {
    waiting_[message->id] = *message;
  }
  if (!problem.empty())
  {
    warnings_->warn("edge_nodes: " + problem);
  }
}

bool NodeSources::registerNode(RegisterNode::Request& request, RegisterNode::Response& response)
{
  if (request.remove != 0)
  {
    const std::string& id = request.node.id;
    waiting_.erase(id);
    response.success = static_cast<uint8_t>(client_->call(
        [this, &id](int64_t now_ns)
        {
          checks_->forget(id);
          return client_->removeNode(id, now_ns);
        }));
    response.message = response.success != 0 ? "removed " + id : "there is no node \"" + id + "\"";
    return true;
  }
  std::string problem;
  if (!add(request.node, &problem))
  {
    problem = "tf has no " + map_->name() + " -> " + request.node.frame_id + "; give the position in " + map_->name();
  }
  response.success = static_cast<uint8_t>(problem.empty());
  if (problem.empty())
  {
    client_->call(
        [this, &id = request.node.id](int64_t now_ns)
        {
          checks_->forget(id);
          client_->engine().setTrusted(id, true, now_ns);
        });
  }
  response.message = problem.empty() ? "knows " + request.node.id + " at " + request.node.address : problem;
  return true;
}

bool NodeSources::nodes(Nodes::Request&, Nodes::Response& response)
{
  client_->call(
      [this, &response](int64_t now_ns)
      {
        const auto links = client_->links();
        for (const OffloadEngine::NodeStatus& status : client_->engine().nodes(now_ns))
        {
          const std::string& id = status.description.id;
          const auto link = links.find(id);
          const uint64_t unasked = link != links.end() ? link->second.unasked : 0;
          response.nodes.push_back(toMsg(status, checks_->status(id), unasked, map_->name()));
        }
      });
  return true;
}

}  // namespace pi_offload
