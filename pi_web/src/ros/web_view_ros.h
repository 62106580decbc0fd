#pragma once

#include "graph/graph_reader.h"
#include "ros/client_requests.h"
#include "ros/raw_message.h"
#include "ros/web_view_ros_options.h"
#include "server/web_server.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>

namespace pi_web
{

/// The vehicle in a browser: a page, and the Foxglove WebSocket protocol, on one port. The thread `web_io` does all but
/// what waits for others: `web_graph` asks master and nodes, `web_params` the parameter server, and each service that
/// clients call has a thread.
class WebViewRos
{
public:
  /// Listens. @throws std::invalid_argument for wrong parameters, std::runtime_error if it cannot listen.
  WebViewRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~WebViewRos();
  WebViewRos(const WebViewRos&) = delete;
  WebViewRos& operator=(const WebViewRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  WebServerOptions serverOptions();
  std::map<std::string, WebFile> files();

  void readGraph();
  void onGraph(const GraphState& graph, const std::map<std::string, MessageType>& types);
  void onAny(bool any);
  void every(double period_s, boost::asio::steady_timer* timer, std::function<void()> function);
  void report(Status& status);

  const WebViewRosOptions options_;
  pi_node::WarningBoard warnings_;
  boost::asio::io_context context_;
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> work_;
  IoQueue queue_;
  ros::NodeHandle node_;
  diagnostic_updater::Updater updater_;
  pi_node::CallbackThread graph_thread_;
  std::unique_ptr<GraphReader> reader_;
  boost::asio::steady_timer graph_timer_;
  boost::asio::steady_timer time_timer_;
  boost::asio::steady_timer diagnostic_timer_;

  Services services_;
  bool reading_ = false;
  bool links_wanted_ = false;  ///< somebody asked since the graph was read
  std::string links_json_ = "[]";
  std::unique_ptr<Channels> channels_;
  std::unique_ptr<ClientPublishers> publishers_;
  std::unique_ptr<ClientRequests> requests_;
  std::unique_ptr<WebServer> server_;
  std::thread thread_;
};

}  // namespace pi_web
