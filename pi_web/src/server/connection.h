#pragma once

#include "protocol/send_queue.h"
#include "server/web_server.h"

#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include <memory>
#include <optional>
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

/// @param tls  null: in the clear.
std::shared_ptr<Connection> makeConnection(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls,
                                           WebServer* server);

/// @tparam Stream  of Beast: TCP in the clear, or TLS.
template <typename Stream>
class ConnectionOver : public Connection, public std::enable_shared_from_this<ConnectionOver<Stream>>
{
public:
  template <typename... Arguments>
  explicit ConnectionOver(WebServer* server, Arguments&&... arguments);
  ~ConnectionOver() override;
  void start() override;
  void abandon() override;

  const std::string& name() const override { return name_; }
  bool mayControl() const override { return control_; }
  void answer(OutMessage message) override;
  void push(uint32_t lane, OutMessage message, size_t most) override;
  void forget(uint32_t lane) override { queue_.remove(lane); }
  bool isReady(uint32_t lane) const override { return queue_.isTaken(lane); }
  uint64_t dropped() const override { return queue_.dropped(); }

private:
  using Socket = boost::beast::websocket::stream<Stream>;
  using Parser = boost::beast::http::request_parser<boost::beast::http::empty_body>;
  using FileResponse = boost::beast::http::response<boost::beast::http::string_body>;

  std::shared_ptr<ConnectionOver> self() { return this->shared_from_this(); }
  boost::beast::tcp_stream& lowest() { return boost::beast::get_lowest_layer(socket_); }
  void readHttp();
  void onHttp();
  void respond(boost::beast::http::status status, const std::string& type, std::string body);
  void sendFile(const std::string& path, const std::string& type);
  template <typename Response>
  void write(Response* response);
  void upgrade();
  void readMessage();
  void onMessage();
  void send();
  void fail(const std::string& why);
  void close(const std::string& why);
  boost::asio::ip::tcp::socket& tcp() { return lowest().socket(); }

  WebServer* server_;  ///< null once it has ended
  Socket socket_;
  std::string name_;
  boost::beast::flat_buffer input_;
  std::optional<Parser> parser_;
  FileResponse response_;
  boost::beast::http::response<boost::beast::http::file_body> download_;
  SendQueue queue_;
  std::optional<OutMessage> under_way_;
  boost::asio::steady_timer wake_;
  bool waking_ = false;
  bool open_ = false;  ///< the handler knows the client
  bool control_ = false;
  bool certified_ = false;  ///< the client showed a certificate of ours
  double tokens_ = 100.0;   ///< messages that the client may still send
  int64_t tokens_ns_ = 0;
  int refused_ = 0;
};

}  // namespace pi_web
