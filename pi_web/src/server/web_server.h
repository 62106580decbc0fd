#pragma once

#include "server/access.h"
#include "server/client.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

namespace pi_web
{

struct WebServerOptions
{
  std::string address = "127.0.0.1";
  int port = 8890;  ///< 0: any that is free
  int max_clients = 64;
  int max_message_bytes = 1000000;    ///< of a client's message
  double max_messages_per_s = 200.0;  ///< of a client, in the mean; a hundred more may come at once
  double silent_s = 20.0;             ///< a client that does not answer for so long is disconnected
  std::string tls_folder;             ///< certificate.pem, key.pem, and ca.pem of operators; empty: no TLS
  AccessOptions access;
};

/// A file of the page, an answer made when it is asked for, or the files of a folder. What is not of the page needs
/// what watching needs.
struct WebFile
{
  std::string type;
  std::string body;
  std::function<std::string()> make;                         ///< in place of body
  std::function<std::string(const std::string& name)> find;  ///< of a folder, "/NAME/": path of a file; "" if none
};

class Connection;
class ConnectionMaker;

/// Serves files over HTTP, and clients over WebSockets of the same port. All calls and callbacks on the thread that
/// runs the context.
class WebServer
{
public:
  using Log = std::function<void(const std::string&)>;
  /// Listens. @param files  by their path, as "/". @param log  gets a line for everything that is refused.
  /// @throws std::runtime_error naming address and port, or the file of TLS, and the way out.
  WebServer(boost::asio::io_context* context, const WebServerOptions& options, std::map<std::string, WebFile> files,
            ClientHandler* handler, Log log);
  /// Disconnects all.
  ~WebServer();

  int port() const { return acceptor_.local_endpoint().port(); }
  size_t clients() const { return clients_; }

private:
  template <typename Stream>
  friend class ConnectionOver;
  void accept();

  boost::asio::io_context* const context_;
  const WebServerOptions options_;
  const std::map<std::string, WebFile> files_;
  ClientHandler* const handler_;
  const Log log_;
  const std::unique_ptr<ConnectionMaker> maker_;
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::steady_timer accept_again_;
  std::set<Connection*> connections_;
  size_t clients_ = 0;  ///< of connections_, those with a WebSocket
};

}  // namespace pi_web
