#pragma once

#include "server/web_server.h"

#include <boost/asio/ip/tcp.hpp>

#include <memory>
#include <string>

namespace pi_web
{

/// One TCP connection: requests for files, which may end in a WebSocket. Keeps itself alive while anything is under
/// way.
class Connection : public Client
{
public:
  virtual void start() = 0;
  /// The server ends: no handler is called any more.
  virtual void abandon() = 0;
};

/// Makes connections of one kind out of sockets that were accepted.
class ConnectionMaker
{
public:
  virtual ~ConnectionMaker() = default;
  virtual std::shared_ptr<Connection> make(boost::asio::ip::tcp::socket socket, WebServer* server) = 0;
};

/// Connections in the clear.
std::unique_ptr<ConnectionMaker> plainConnections();

/// Connections over TLS. Their code is loaded when it is asked for: OpenSSL takes 4 MB.
/// @param folder  certificate.pem, key.pem, and ca.pem of operators.
/// @throws std::runtime_error naming the file, and the way out.
std::unique_ptr<ConnectionMaker> tlsConnections(const std::string& folder);

/// What the library of TLS exports, as MAKE_TLS_CONNECTIONS; the caller owns the result. Throws as tlsConnections().
using MakeTlsConnections = ConnectionMaker*(const char* folder);
constexpr char MAKE_TLS_CONNECTIONS[] = "piWebMakeTlsConnections";

}  // namespace pi_web
