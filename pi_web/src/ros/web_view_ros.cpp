#include "ros/web_view_ros.h"

#include "graph/graph_messages.h"
#include "ros/known_types.h"
#include "ros/parameter_json.h"
#include "server/files.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/ros/node_options.h>
#include <ros/master.h>
#include <ros/this_node.h>

#include <boost/asio/ip/address.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <cstdlib>
#include <stdexcept>
#include <utility>

namespace pi_web
{
namespace
{

using nlohmann::json;

constexpr int MAX_WAITING = 8;         // of a client, for services and parameters
constexpr const char* ADDRESS_PARAMETER = "address_in_use";  // for pi_edge open
constexpr double TIME_PERIOD_S = 0.1;   // of simulated time

std::string packagePath()
{
  const char* const path = std::getenv("ROS_PACKAGE_PATH");
  return (path == nullptr ? "" : path) + std::string(":/usr/share");
}

std::set<std::string> resolved(const ros::NodeHandle& node, const std::vector<std::string>& names)
{
  std::set<std::string> result;
  for (const std::string& name : names)
  {
    result.insert(node.resolveName(name));
  }
  return result;
}

}  // namespace

WebViewRos::WebViewRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : options_(pi_node::loadNodeOptions<WebViewRosOptions>(private_node, "web_view", {ADDRESS_PARAMETER}))
  , warnings_(options_.warning_period_s, pi_node::warningLog<WebViewRosOptions>("web_view"))
  , work_(boost::asio::make_work_guard(context_))
  , queue_(&context_)
  , node_(node)
  , updater_(node, private_node, private_node.getNamespace())
  , graph_thread_("web_graph")
  , parameter_thread_("web_params")
  , graph_timer_(context_)
  , time_timer_(context_)
  , diagnostic_timer_(context_)
  , types_(knownTypes())
  , services_(&warnings_)
{
  node_.setCallbackQueue(&queue_);
  const char* const uri = std::getenv("ROS_MASTER_URI");
  reader_ = std::make_unique<GraphReader>(uri == nullptr ? "http://localhost:11311" : uri, ros::this_node::getName(),
                                          options_.allow_control ? resolved(node, options_.services) : std::set<std::string>(),
                                          options_.answer_limit_s);
  for (const auto& [type, definition] : types_)
  {
    reader_->addType(type, definition);
  }
  channels_ = std::make_unique<Channels>(node_, options_, &warnings_);
  publishers_ = std::make_unique<ClientPublishers>(node_, resolved(node, options_.publish_topics));
  server_ = std::make_unique<WebServer>(&context_, serverOptions(), files(), this,
                                        [this](const std::string& text) { warnings_.warn(text); });
  updater_.setHardwareID("none");
  updater_.add("web_view", [this](Status& status) { report(status); });
  every(options_.diagnostic_period, &diagnostic_timer_, [this] { updater_.force_update(); });
  const bool v6 = options_.address.find(':') != std::string::npos;
  const std::string url = "http://" + (v6 ? "[" + options_.address + "]" : options_.address) + ":" +
                          std::to_string(server_->port()) + "/";
  private_node.setParam(ADDRESS_PARAMETER, url);
  ROS_INFO_STREAM_NAMED("web_view", "the vehicle is at " << url << (options_.allow_control ? "; with the token of " +
                                                                                                 options_.token_file +
                                                                                                 " it can be driven"
                                                                                           : ""));
  graph_thread_.start();
  parameter_thread_.start();
  thread_ = std::thread(
      [this]
      {
        pthread_setname_np(pthread_self(), "web_io");
        while (!context_.stopped())
        {
          try
          {
            context_.run();
          }
          catch (const std::exception& error)
          {
            warnings_.error(std::string("a callback failed: ") + error.what());
          }
        }
      });
}

WebViewRos::~WebViewRos()
{
  graph_thread_.stop();
  parameter_thread_.stop();
  services_.stop();
  context_.stop();
  thread_.join();
  server_.reset();
}

WebServerOptions WebViewRos::serverOptions()
{
  WebServerOptions server;
  server.address = options_.address;
  server.port = options_.port;
  server.max_clients = options_.max_clients;
  server.max_message_bytes = options_.max_message_bytes;
  server.max_messages_per_s = options_.max_messages_per_s;
  server.silent_s = options_.silent_s;
  server.access.allow_control = options_.allow_control;
  server.access.host_names = options_.host_names;
  server.access.web_origins = options_.web_origins;
  server.access.token_to_watch = !boost::asio::ip::make_address(options_.address).is_loopback();
  if (server.access.token_to_watch || options_.allow_control)
  {
    server.access.token = tokenOfFile(expanded(options_.token_file));
  }
  return server;
}

std::map<std::string, WebFile> WebViewRos::files() const
{
  const std::string own = packageFolder("pi_web", packagePath());
  std::map<std::string, WebFile> files =
      pageFiles(options_.page_folder.empty() ? own + "/www" : expanded(options_.page_folder));
  const std::string incidents = expanded(options_.incidents_folder);
  files["/incidents.json"] = {"application/json", "", [incidents] { return incidentsJson(incidents); }};
  return files;
}

void WebViewRos::every(double period_s, boost::asio::steady_timer* timer, std::function<void()> function)
{
  timer->expires_after(std::chrono::nanoseconds(static_cast<int64_t>(period_s * 1e9)));
  timer->async_wait(
      [=](const boost::system::error_code& cancelled)
      {
        if (!cancelled)
        {
          function();
          every(period_s, timer, function);
        }
      });
}

void WebViewRos::onOpen(Client* client)
{
  clients_[client].number = ++last_client_;
  json capabilities = {"parameters", "connectionGraph", "assets"};
  if (ros::Time::isSimTime())
  {
    capabilities.push_back("time");
  }
  if (client->mayControl())
  {
    capabilities.push_back("clientPublish");
    capabilities.push_back("services");
  }
  client->answer(textMessage({{"op", "serverInfo"},
                              {"name", "π-Edge"},
                              {"capabilities", capabilities},
                              {"supportedEncodings", {"ros1"}},
                              {"metadata", {{"ROS_DISTRO", "noetic"}}},
                              {"sessionId", std::to_string(reinterpret_cast<uintptr_t>(this))}}));
  client->answer(textMessage({{"op", "advertise"}, {"channels", channels_->describe(channels_->ids())}}));
  if (client->mayControl())
  {
    client->answer(textMessage(services_.advertisement()));
  }
  if (clients_.size() == 1)
  {
    readGraph();
    every(options_.graph_period_s, &graph_timer_, [this] { readGraph(); });
    if (ros::Time::isSimTime())
    {
      every(TIME_PERIOD_S, &time_timer_,
            [this]
            {
              for (const auto& [one, state] : clients_)
              {
                constexpr uint32_t no_subscription = ~0U;
                one->push(no_subscription, timeMessage(ros::Time::now().toNSec()), 1);
              }
            });
    }
  }
}

void WebViewRos::onClose(Client* client)
{
  channels_->remove(client);
  publishers_->remove(client);
  clients_.erase(client);
  if (clients_.empty())
  {
    graph_timer_.cancel();
    time_timer_.cancel();
  }
}

void WebViewRos::workFor(Client* client, pi_node::CallbackThread* thread, std::function<OutMessage()> work)
{
  ClientState& state = clients_.at(client);
  if (state.waiting >= MAX_WAITING)
  {
    throw std::invalid_argument(std::to_string(MAX_WAITING) + " requests of this client wait for their answer");
  }
  ++state.waiting;
  thread->post(
      [this, client, number = state.number, work = std::move(work)]
      {
        OutMessage answer;
        try
        {
          answer = work();
        }
        catch (const std::exception& error)
        {
          answer = statusMessage(StatusLevel::ERROR, error.what());
        }
        boost::asio::post(context_,
                          [this, client, number, answer = std::move(answer)]
                          {
                            const auto known = clients_.find(client);
                            if (known != clients_.end() && known->second.number == number)
                            {
                              --known->second.waiting;
                              client->answer(answer);
                            }
                          });
      });
}

template <typename Asked>
void WebViewRos::handle(Client* client, const Asked& asked)
{
  if constexpr (std::is_same_v<Asked, request::Subscribe>)
  {
    for (const auto& [subscription, channel] : asked.subscriptions)
    {
      channels_->subscribe(client, subscription, channel);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::Unsubscribe>)
  {
    for (const uint32_t subscription : asked.subscriptions)
    {
      channels_->unsubscribe(client, subscription);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::GetParameters>)
  {
    workFor(client, &parameter_thread_, [this, asked] { return answerTo(asked, *reader_); });
  }
  else if constexpr (std::is_same_v<Asked, request::WatchGraph>)
  {
    clients_.at(client).watches_graph = asked.on;
    if (const json all = graphUpdate(GraphState(), graph_); asked.on && !all.is_null())
    {
      client->answer(textMessage(all));
    }
  }
  else if constexpr (std::is_same_v<Asked, request::FetchAsset>)
  {
    try
    {
      const std::string content = assetOf(asked.uri, packagePath());
      client->answer(assetResponse(asked.id, "", std::make_shared<Bytes>(content.begin(), content.end())));
    }
    catch (const std::invalid_argument& error)
    {
      client->answer(assetResponse(asked.id, error.what(), nullptr));
    }
  }
  else
  {
    if (!client->mayControl())
    {
      throw std::invalid_argument("this connection may only watch; it needs the token and allow_control");
    }
    control(client, asked);
  }
}

template <typename Asked>
void WebViewRos::control(Client* client, const Asked& asked)
{
  if constexpr (std::is_same_v<Asked, request::Advertise>)
  {
    for (const request::ClientChannel& channel : asked.channels)
    {
      publishers_->advertise(client, channel, types_);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::Unadvertise>)
  {
    for (const uint32_t channel : asked.channels)
    {
      publishers_->unadvertise(client, channel);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::Publish>)
  {
    publishers_->publish(client, asked);
  }
  else if constexpr (std::is_same_v<Asked, request::SetParameters>)
  {
    workFor(client, &parameter_thread_, [this, asked] { return answerTo(asked, *reader_); });
  }
  else
  {
    static_assert(std::is_same_v<Asked, request::CallService>);
    const Services::Service& service = services_.at(asked.service);
    if (asked.encoding != "ros1")
    {
      throw std::invalid_argument("encoding of a call must be ros1");
    }
    ROS_INFO_STREAM_NAMED("web_view", client->name() << " calls " << service.name);
    workFor(client, service.thread.get(),
            [this, name = service.name, id = asked.service, call = asked.call, bytes = std::string(asked.payload)]
            {
              try
              {
                return serviceResponse(id, call, "ros1", reader_->call(name, bytes, options_.call_limit_s));
              }
              catch (const std::exception& error)
              {
                return serviceFailure(id, call, error.what());
              }
            });
  }
}

void WebViewRos::onRequest(Client* client, const Request& request)
{
  std::visit([&](const auto& one) { handle(client, one); }, request);
}

void WebViewRos::readGraph()
{
  if (reading_)
  {
    return;  // the master takes its time
  }
  reading_ = true;
  graph_thread_.post(
      [this]
      {
        std::optional<GraphState> graph;
        try
        {
          graph = reader_->read();
          for (const auto& [topic, nodes] : graph->publishers)
          {
            if (const auto type = graph->types.find(topic); type != graph->types.end())
            {
              reader_->learnType(topic, type->second, nodes);
            }
          }
        }
        catch (const std::exception& error)
        {
          warnings_.warn(std::string("the graph is not read: ") + error.what());
        }
        boost::asio::post(context_,
                          [this, graph = std::move(graph), types = reader_->types()]
                          {
                            reading_ = false;
                            if (graph)
                            {
                              onGraph(*graph, types);
                            }
                          });
      });
}

void WebViewRos::onGraph(const GraphState& graph, const std::map<std::string, MessageType>& types)
{
  types_ = types;
  const Channels::Change change = channels_->update(graph, types);
  if (!change.removed.empty())
  {
    broadcast({{"op", "unadvertise"}, {"channelIds", change.removed}});
  }
  if (!change.added.empty())
  {
    broadcast({{"op", "advertise"}, {"channels", channels_->describe(change.added)}});
  }
  for (const json& told : services_.update(graph.service_types))
  {
    broadcast(told, true);
  }
  if (const json update = graphUpdate(graph_, graph); !update.is_null())
  {
    for (const auto& [client, state] : clients_)
    {
      if (state.watches_graph)
      {
        client->answer(textMessage(update));
      }
    }
  }
  graph_ = graph;
}

void WebViewRos::broadcast(const json& object, bool only_control)
{
  for (const auto& [client, state] : clients_)
  {
    if (client->mayControl() || !only_control)
    {
      client->answer(textMessage(object));
    }
  }
}

void WebViewRos::report(Status& status)
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  if (warnings.empty())
  {
    status.summary(diagnostic_msgs::DiagnosticStatus::OK, std::to_string(clients_.size()) + " watch");
  }
  else
  {
    status.summary(diagnostic_msgs::DiagnosticStatus::WARN, warnings.front().text);
  }
  uint64_t dropped = 0;
  for (const auto& [client, state] : clients_)
  {
    dropped += client->dropped();
  }
  status.add("clients", clients_.size());
  status.add("topics watched", channels_->watched());
  status.add("channels", channels_->size());
  status.add("messages replaced by newer ones", dropped);
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_web
