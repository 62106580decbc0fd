#pragma once

#include "protocol/send_queue.h"
#include "server/connection.h"

#include <netinet/tcp.h>
#include <sys/socket.h>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

namespace pi_web
{

namespace beast = boost::beast;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;

constexpr auto HTTP_LIMIT = std::chrono::seconds(10);  // for a request, and between two
constexpr auto DOWNLOAD_LIMIT = std::chrono::minutes(10);
constexpr int UNSENT_BYTES = 128 * 1024;  // that the kernel keeps: what waits there cannot be overtaken
constexpr int MAX_REFUSED = 50;           // requests of a client that means us no good
constexpr double BURST_MESSAGES = 100.0;

/// The first of our sub-protocols that the client offers; empty if there is none.
std::string chosenProtocol(beast::string_view offered);

/// Of the steady clock.
int64_t connectionNowNs();

inline std::string_view textOf(beast::string_view text)
{
  return {text.data(), text.size()};
}

/// @tparam Stream  of Beast: TCP in the clear, or TLS.
template <typename Stream>
class ConnectionOver : public Connection, public std::enable_shared_from_this<ConnectionOver<Stream>>
{
public:
  template <typename... Arguments>
  explicit ConnectionOver(WebServer* server, Arguments&&... arguments);
  ~ConnectionOver() override;
  void start() override { readHttp(); }
  void abandon() override;

  const std::string& name() const override { return name_; }
  bool mayControl() const override { return control_; }
  void answer(OutMessage message) override;
  void push(uint32_t lane, OutMessage message, size_t most) override;
  void forget(uint32_t lane) override { queue_.remove(lane); }
  bool isReady(uint32_t lane) const override { return queue_.isTaken(lane); }
  uint64_t dropped() const override { return queue_.dropped(); }

protected:
  using Socket = websocket::stream<Stream>;
  using Parser = http::request_parser<http::empty_body>;
  using FileResponse = http::response<http::string_body>;

  std::shared_ptr<ConnectionOver> self() { return this->shared_from_this(); }
  beast::tcp_stream& lowest() { return beast::get_lowest_layer(socket_); }
  void readHttp();
  void onHttp();
  void respond(http::status status, const std::string& type, std::string body);
  void sendFile(const std::string& path, const std::string& type);
  template <typename Response>
  void write(Response* response);
  void upgrade();
  void readMessage();
  void onMessage();
  void send();
  void fail(const std::string& why);
  void close(const std::string& why);
  void log(const std::string& line) { server_->log_(line); }
  boost::asio::ip::tcp::socket& tcp() { return lowest().socket(); }

  WebServer* server_;  ///< null once it has ended
  Socket socket_;
  std::string name_;
  beast::flat_buffer input_;
  std::optional<Parser> parser_;
  FileResponse response_;
  http::response<http::file_body> download_;
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

template <typename Stream>
template <typename... Arguments>
ConnectionOver<Stream>::ConnectionOver(WebServer* server, Arguments&&... arguments)
  : server_(server), socket_(std::forward<Arguments>(arguments)...), wake_(*server->context_)
{
  beast::error_code ignored;
  const auto peer = tcp().remote_endpoint(ignored);
  name_ = peer.address().to_string(ignored) + ":" + std::to_string(peer.port());
  tcp().set_option(boost::asio::ip::tcp::no_delay(true), ignored);
  setsockopt(tcp().native_handle(), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &UNSENT_BYTES, sizeof UNSENT_BYTES);
  server_->connections_.insert(this);
}

template <typename Stream>
ConnectionOver<Stream>::~ConnectionOver()
{
  if (server_ != nullptr)
  {
    server_->connections_.erase(this);
  }
}

template <typename Stream>
void ConnectionOver<Stream>::abandon()
{
  server_ = nullptr;
  beast::error_code ignored;
  wake_.cancel(ignored);
  tcp().close(ignored);
}

template <typename Stream>
void ConnectionOver<Stream>::readHttp()
{
  parser_.emplace();
  parser_->body_limit(0);  // the header has a limit of 8 kB
  lowest().expires_after(HTTP_LIMIT);
  http::async_read_header(socket_.next_layer(), input_, *parser_,
                          [self = self()](beast::error_code error, size_t)
                          {
                            if (!error && self->server_ != nullptr)
                            {
                              self->onHttp();
                            }
                          });
}

template <typename Stream>
void ConnectionOver<Stream>::onHttp()
{
  const auto& request = parser_->get();
  const std::string_view target = textOf(request.target());
  const bool websocket_wanted = websocket::is_upgrade(request);
  const std::string path(target.substr(0, target.find('?')));
  const size_t folder_end = path.rfind('/') + 1;
  auto file = server_->files_.find(path);
  if (file == server_->files_.end() && folder_end > 1 && folder_end < path.size())
  {
    file = server_->files_.find(path.substr(0, folder_end));
  }
  if (request.method() != http::verb::get && request.method() != http::verb::head)
  {
    respond(http::status::method_not_allowed, "text/plain", "only GET\n");
    return;
  }
  if (!websocket_wanted && file == server_->files_.end())
  {
    respond(http::status::not_found, "text/plain", "there is no such file\n");
    return;
  }
  if (!websocket_wanted && !file->second.make && !file->second.find)
  {
    respond(http::status::ok, file->second.type, file->second.body);
    return;
  }
  const Access access = accessOf(server_->options_.access, target, textOf(request[http::field::host]),
                                 textOf(request[http::field::origin]), certified_);
  if (!access.refusal.empty())
  {
    log(name_ + " is refused: " + access.refusal);
    respond(http::status::unauthorized, "text/plain", access.refusal + "\n");
    return;
  }
  if (!websocket_wanted && file->second.find)
  {
    sendFile(file->second.find(path.substr(folder_end)), file->second.type);
    return;
  }
  if (!websocket_wanted)
  {
    respond(http::status::ok, file->second.type, file->second.make());
    return;
  }
  const std::string protocol = chosenProtocol(request[http::field::sec_websocket_protocol]);
  const std::string why = protocol.empty() ? "no common sub-protocol; offer foxglove.sdk.v1 or foxglove.websocket.v1"
                          : server_->clients_ >= static_cast<size_t>(server_->options_.max_clients)
                              ? "max_clients = " + std::to_string(server_->options_.max_clients) + " are connected"
                              : "";
  if (!why.empty())
  {
    log(name_ + " is refused: " + why);
    respond(protocol.empty() ? http::status::bad_request : http::status::service_unavailable, "text/plain", why + "\n");
    return;
  }
  control_ = access.control;
  socket_.set_option(websocket::stream_base::decorator(
      [protocol](websocket::response_type& response) { response.set(http::field::sec_websocket_protocol, protocol); }));
  upgrade();
}

template <typename Stream>
void ConnectionOver<Stream>::respond(http::status status, const std::string& type, std::string body)
{
  const auto& request = parser_->get();
  response_ = FileResponse(status, request.version());
  response_.set(http::field::content_type, type);
  response_.body() = std::move(body);
  response_.prepare_payload();
  if (request.method() == http::verb::head)
  {
    response_.body().clear();
  }
  response_.keep_alive(request.keep_alive() && status == http::status::ok);
  lowest().expires_after(HTTP_LIMIT);
  write(&response_);
}

template <typename Stream>
void ConnectionOver<Stream>::sendFile(const std::string& path, const std::string& type)
{
  const auto& request = parser_->get();
  http::file_body::value_type file;
  beast::error_code error;
  file.open(path.c_str(), beast::file_mode::scan, error);
  if (path.empty() || error || request.method() == http::verb::head)
  {
    respond(path.empty() || error ? http::status::not_found : http::status::ok, "text/plain",
            path.empty() ? "there is no such file\n"
            : error      ? error.message() + "\n"
                         : "");
    return;
  }
  download_ = decltype(download_)(http::status::ok, request.version());
  download_.set(http::field::content_type, type);
  download_.body() = std::move(file);
  download_.prepare_payload();
  download_.keep_alive(false);
  lowest().expires_after(DOWNLOAD_LIMIT);
  write(&download_);
}

template <typename Stream>
template <typename Response>
void ConnectionOver<Stream>::write(Response* response)
{
  response->set(http::field::cache_control, "no-cache");
  response->set("X-Content-Type-Options", "nosniff");
  response->set("Referrer-Policy", "no-referrer");  // the address may hold the token
  response->set("Content-Security-Policy",
                "default-src 'self'; img-src 'self' blob:; connect-src 'self' ws: wss:; frame-ancestors 'none'");
  http::async_write(socket_.next_layer(), *response,
                    [self = self(), response](beast::error_code error, size_t)
                    {
                      if (error || self->server_ == nullptr)
                      {
                        return;
                      }
                      if (response->keep_alive())
                      {
                        self->readHttp();
                        return;
                      }
                      beast::error_code ignored;
                      self->tcp().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
                    });
}

template <typename Stream>
void ConnectionOver<Stream>::upgrade()
{
  lowest().expires_never();
  const auto silent = std::chrono::milliseconds(static_cast<int64_t>(server_->options_.silent_s * 1000.0));
  socket_.set_option(websocket::stream_base::timeout{HTTP_LIMIT, silent, true});
  socket_.read_message_max(static_cast<size_t>(server_->options_.max_message_bytes));
  socket_.auto_fragment(false);
  socket_.async_accept(parser_->get(),
                       [self = self()](beast::error_code error)
                       {
                         if (error || self->server_ == nullptr)
                         {
                           return;
                         }
                         self->parser_.reset();
                         self->open_ = true;
                         self->tokens_ns_ = connectionNowNs();
                         ++self->server_->clients_;
                         self->server_->handler_->onOpen(self.get());
                         self->readMessage();
                       });
}

template <typename Stream>
void ConnectionOver<Stream>::readMessage()
{
  socket_.async_read(input_,
                     [self = self()](beast::error_code error, size_t)
                     {
                       if (self->server_ == nullptr || !self->open_)
                       {
                         return;
                       }
                       if (error)
                       {
                         const bool usual = error == websocket::error::closed || error == boost::asio::error::eof ||
                                            error == boost::asio::error::connection_reset ||
                                            error == boost::asio::error::operation_aborted;
                         self->fail(usual ? "" : error.message());
                         return;
                       }
                       self->onMessage();
                     });
}

template <typename Stream>
void ConnectionOver<Stream>::onMessage()
{
  const int64_t now_ns = connectionNowNs();
  tokens_ = std::min(BURST_MESSAGES,
                     tokens_ + static_cast<double>(now_ns - tokens_ns_) * 1e-9 * server_->options_.max_messages_per_s);
  tokens_ns_ = now_ns;
  if (tokens_ < 1.0)
  {
    close("more than max_messages_per_s");
    return;
  }
  tokens_ -= 1.0;
  const auto bytes = input_.cdata();
  const std::string_view message(static_cast<const char*>(bytes.data()), bytes.size());
  try
  {
    server_->handler_->onRequest(this, socket_.got_text() ? decodeText(message) : decodeBinary(message));
  }
  catch (const std::invalid_argument& error)
  {
    answer(statusMessage(StatusLevel::ERROR, error.what()));
    if (++refused_ == MAX_REFUSED)
    {
      close(std::to_string(MAX_REFUSED) + " requests were wrong, at last: " + error.what());
    }
  }
  input_.consume(input_.size());
  if (open_)
  {
    readMessage();
  }
}

template <typename Stream>
void ConnectionOver<Stream>::answer(OutMessage message)
{
  if (!open_)
  {
    return;
  }
  if (!queue_.pushAnswer(std::move(message)))
  {
    close("it asks and does not read the answers");
    return;
  }
  send();
}

template <typename Stream>
void ConnectionOver<Stream>::push(uint32_t lane, OutMessage message, size_t most)
{
  if (open_)
  {
    queue_.push(lane, std::move(message), most);
    send();
  }
}

template <typename Stream>
void ConnectionOver<Stream>::send()
{
  if (under_way_ || !open_)
  {
    return;
  }
  under_way_ = queue_.next(connectionNowNs());
  if (!under_way_)
  {
    if (const auto ready_ns = queue_.readyAt(); ready_ns && !waking_)
    {
      waking_ = true;
      wake_.expires_at(std::chrono::steady_clock::time_point(std::chrono::nanoseconds(*ready_ns)));
      wake_.async_wait(
          [self = self()](beast::error_code)
          {
            self->waking_ = false;
            self->send();
          });
    }
    return;
  }
  socket_.binary(!under_way_->text);
  const std::array<boost::asio::const_buffer, 2> buffers = {
      boost::asio::buffer(under_way_->head),
      under_way_->body ? boost::asio::buffer(*under_way_->body) : boost::asio::const_buffer()};
  socket_.async_write(buffers,
                      [self = self()](beast::error_code error, size_t)
                      {
                        self->queue_.sent(connectionNowNs());
                        self->under_way_.reset();
                        if (!error)  // an error ends the reading, too
                        {
                          self->send();
                        }
                      });
}

/// The connection has ended.
template <typename Stream>
void ConnectionOver<Stream>::fail(const std::string& why)
{
  if (!open_)
  {
    return;
  }
  open_ = false;
  if (!why.empty())
  {
    log(name_ + " is disconnected: " + why);
  }
  --server_->clients_;
  server_->handler_->onClose(this);
  beast::error_code ignored;
  wake_.cancel(ignored);
  tcp().close(ignored);  // also ends a write that waits for the client
}

template <typename Stream>
void ConnectionOver<Stream>::close(const std::string& why)
{
  // Not within the handler's call, which may hold the client.
  boost::asio::post(*server_->context_,
                    [self = self(), why]
                    {
                      if (self->server_ != nullptr)
                      {
                        self->fail(why);
                      }
                    });
}

}  // namespace pi_web
