#pragma once

#include "graph/graph_reader.h"
#include "ros/channels.h"
#include "ros/client_publishers.h"
#include "ros/raw_message.h"
#include "ros/services.h"
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
class WebViewRos : public ClientHandler
{
public:
  /// Listens. @throws std::invalid_argument for wrong parameters, std::runtime_error if it cannot listen.
  WebViewRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~WebViewRos() override;
  WebViewRos(const WebViewRos&) = delete;
  WebViewRos& operator=(const WebViewRos&) = delete;

private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;
  struct ClientState
  {
    uint64_t number = 0;
    bool watches_graph = false;
    int waiting = 0;  ///< for services and parameters
  };

  WebServerOptions serverOptions();
  std::map<std::string, WebFile> files() const;

  void onOpen(Client* client) override;
  void onRequest(Client* client, const Request& request) override;
  void onClose(Client* client) override;
  template <typename Asked>
  void handle(Client* client, const Asked& asked);
  template <typename Asked>
  void control(Client* client, const Asked& asked);

  /// Works on another thread, and answers the client if it is still there.
  void workFor(Client* client, pi_node::CallbackThread* thread, std::function<OutMessage()> work);
  void readGraph();
  void onGraph(const GraphState& graph, const std::map<std::string, MessageType>& types);
  void broadcast(const nlohmann::json& object, bool only_control = false);
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
  pi_node::CallbackThread parameter_thread_;
  std::unique_ptr<GraphReader> reader_;
  boost::asio::steady_timer graph_timer_;
  boost::asio::steady_timer time_timer_;
  boost::asio::steady_timer diagnostic_timer_;

  std::map<std::string, MessageType> types_;
  Services services_;
  GraphState graph_;
  bool reading_ = false;
  uint64_t last_client_ = 0;
  std::map<Client*, ClientState> clients_;
  std::unique_ptr<Channels> channels_;
  std::unique_ptr<ClientPublishers> publishers_;
  std::unique_ptr<WebServer> server_;
  std::thread thread_;
};

}  // namespace pi_web
