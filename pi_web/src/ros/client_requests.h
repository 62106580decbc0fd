#pragma once

#include "graph/graph_reader.h"
#include "ros/channels.h"
#include "ros/client_publishers.h"
#include "ros/services.h"
#include "server/client.h"

#include <pi_node/ros/callback_thread.h>
#include <nlohmann/json.hpp>

#include <boost/asio/io_context.hpp>
#include <functional>
#include <map>
#include <string>

namespace pi_web
{

/// Does what clients ask for. The context's thread calls all methods; the parameter server and services are asked on
/// threads of their own.
class ClientRequests : public ClientHandler
{
public:
  /// All outlive this.
  struct Parts
  {
    boost::asio::io_context* context = nullptr;
    const GraphReader* reader = nullptr;  ///< its const methods alone
    Channels* channels = nullptr;
    ClientPublishers* publishers = nullptr;
    Services* services = nullptr;
    double call_limit_s = 0.0;
    std::function<void(bool any)> on_any;  ///< the first client has come, or the last one gone
  };
  explicit ClientRequests(const Parts& parts);
  /// No work on other threads begins afterwards.
  void stop();

  void onOpen(Client* client) override;
  void onRequest(Client* client, const Request& request) override;
  void onClose(Client* client) override;

  void broadcast(const nlohmann::json& object, bool only_control = false);
  void onGraph(const GraphState& graph, const std::map<std::string, MessageType>& types);
  /// Simulated time.
  void sendTime();

  size_t clients() const { return clients_.size(); }
  uint64_t dropped() const;

private:
  struct State
  {
    uint64_t number = 0;
    bool watches_graph = false;
    int waiting = 0;  ///< for services and parameters
  };
  template <typename Asked>
  void handle(Client* client, const Asked& asked);
  template <typename Asked>
  void control(Client* client, const Asked& asked);
  /// Works on another thread, and answers the client if it is still there.
  void workFor(Client* client, pi_node::CallbackThread* thread, std::function<OutMessage()> work);

  const Parts parts_;
  const std::string session_;
  pi_node::CallbackThread parameter_thread_;
  std::map<Client*, State> clients_;
  std::map<std::string, MessageType> types_;
  GraphState graph_;
  uint64_t last_client_ = 0;
};

}  // namespace pi_web
