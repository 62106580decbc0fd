#include "ros/web_view_ros.h"

#include "graph/graph_messages.h"
#include "ros/known_types.h"
#include "server/files.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/ros/node_options.h>
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

constexpr const char* ADDRESS_PARAMETER = "address_in_use";  // for pi_edge open
constexpr double TIME_PERIOD_S = 0.1;                        // of simulated time

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
  , graph_timer_(context_)
  , time_timer_(context_)
  , diagnostic_timer_(context_)
  , services_(&warnings_)
{
  node_.setCallbackQueue(&queue_);
  const char* const uri = std::getenv("ROS_MASTER_URI");
  reader_ = std::make_unique<GraphReader>(
      uri == nullptr ? "http://localhost:11311" : uri, ros::this_node::getName(),
      options_.allow_control ? resolved(node, options_.services) : std::set<std::string>(), options_.answer_limit_s);
  for (const auto& [type, definition] : knownTypes())
  {
    reader_->addType(type, definition);
  }
  channels_ = std::make_unique<Channels>(node_, options_, &warnings_);
  publishers_ = std::make_unique<ClientPublishers>(node_, resolved(node, options_.publish_topics));
  requests_ = std::make_unique<ClientRequests>(
      ClientRequests::Parts{&context_, reader_.get(), channels_.get(), publishers_.get(), &services_,
                            options_.call_limit_s, [this](bool any) { onAny(any); }});
  requests_->onGraph(GraphState(), reader_->types());
  server_ = std::make_unique<WebServer>(&context_, serverOptions(), files(), requests_.get(),
                                        [this](const std::string& text) { warnings_.warn(text); });
  updater_.setHardwareID("none");
  updater_.add("web_view", [this](Status& status) { report(status); });
  every(options_.diagnostic_period, &diagnostic_timer_, [this] { updater_.force_update(); });
  const bool v6 = options_.address.find(':') != std::string::npos;
  const std::string url = (options_.tls_folder.empty() ? "http://" : "https://") +
                          (v6 ? "[" + options_.address + "]" : options_.address) + ":" +
                          std::to_string(server_->port()) + "/";
  private_node.setParam(ADDRESS_PARAMETER, url);
  ROS_INFO_STREAM_NAMED("web_view", "the vehicle is at "
                                        << url
                                        << (options_.allow_control
                                                ? "; with the token of " + options_.token_file + " it can be driven"
                                                : ""));
  graph_thread_.start();
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
  requests_->stop();
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
  server.tls_folder = expanded(options_.tls_folder);
  server.access.host_names = options_.host_names;
  server.access.web_origins = options_.web_origins;
  server.access.token_to_watch = !boost::asio::ip::make_address(options_.address).is_loopback();
  if (server.access.token_to_watch || options_.allow_control)
  {
    server.access.token = tokenOfFile(expanded(options_.token_file));
  }
  return server;
}

std::map<std::string, WebFile> WebViewRos::files()
{
  const std::string own = packageFolder("pi_web");
  std::map<std::string, WebFile> files =
      pageFiles(options_.page_folder.empty() ? own + "/www" : expanded(options_.page_folder));
  const std::string incidents = expanded(options_.incidents_folder);
  files["/incidents.json"] = {"application/json", "", [incidents] { return incidentsJson(incidents); }, nullptr};
  files["/incidents/"] = {"application/octet-stream", "", nullptr,
                          [incidents](const std::string& name) { return incidentFile(incidents, name); }};
  // Asking all nodes takes a while: a page gets what was known, and what is known then at its next try.
  files["/links.json"] = {"application/json", "",
                          [this]
                          {
                            links_wanted_ = true;
                            return links_json_;
                          },
                          nullptr};
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

void WebViewRos::readGraph()
{
  if (reading_ || requests_->clients() == 0)
  {
    return;  // the master takes its time, or the timer had just run out when the last client went
  }
  reading_ = true;
  graph_thread_.post(
      [this, links_wanted = std::exchange(links_wanted_, false)]
      {
        std::optional<GraphState> graph;
        std::optional<std::string> links;
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
          if (links_wanted)
          {
            links = linksJson(reader_->links(*graph));
          }
        }
        catch (const std::exception& error)
        {
          warnings_.warn(std::string("the graph is not read: ") + error.what());
        }
        boost::asio::post(context_,
                          [this, graph = std::move(graph), links = std::move(links), types = reader_->types()]
                          {
                            reading_ = false;
                            links_json_ = links.value_or(links_json_);
                            if (graph)
                            {
                              onGraph(*graph, types);
                            }
                          });
      });
}

void WebViewRos::onGraph(const GraphState& graph, const std::map<std::string, MessageType>& types)
{
  const Channels::Change change = channels_->update(graph, types);
  if (!change.removed.empty())
  {
    requests_->broadcast({{"op", "unadvertise"}, {"channelIds", change.removed}});
  }
  if (!change.added.empty())
  {
    requests_->broadcast({{"op", "advertise"}, {"channels", channels_->describe(change.added)}});
  }
  for (const json& told : services_.update(graph.service_types))
  {
    requests_->broadcast(told, true);
  }
  requests_->onGraph(graph, types);
}

void WebViewRos::onAny(bool any)
{
  if (!any)
  {
    graph_timer_.cancel();
    time_timer_.cancel();
    return;
  }
  readGraph();
  every(options_.graph_period_s, &graph_timer_, [this] { readGraph(); });
  if (ros::Time::isSimTime())
  {
    every(TIME_PERIOD_S, &time_timer_, [this] { requests_->sendTime(); });
  }
}

void WebViewRos::report(Status& status)
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  if (warnings.empty())
  {
    status.summary(diagnostic_msgs::DiagnosticStatus::OK, std::to_string(requests_->clients()) + " watch");
  }
  else
  {
    status.summary(diagnostic_msgs::DiagnosticStatus::WARN, warnings.front().text);
  }
  status.add("clients", requests_->clients());
  status.add("topics watched", channels_->watched());
  status.add("channels", channels_->size());
  status.add("messages replaced by newer ones", requests_->dropped());
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_web
