#include "server/health_endpoint.h"

#include <fcntl.h>
#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_node/unique_fd.h>
#include <sys/socket.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>

#include <array>
#include <chrono>
#include <exception>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

#include "wire/socket_tools.h"

namespace pi_offload
{
namespace
{

namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::asio::ip::tcp;

constexpr uint32_t MAX_REQUEST_BYTES = 8192;
constexpr char PLAIN[] = "text/plain; charset=utf-8";

using Response = http::response<http::string_body>;

Response responseOf(http::status status, const std::string& type, std::string body)
{
  Response response(status, 11);
  response.set(http::field::content_type, type);
  response.body() = std::move(body);
  response.prepare_payload();
  response.keep_alive(false);
  return response;
}

Response answerTo(http::verb method, beast::string_view target, const HealthEndpoint::Callbacks& callbacks)
{
  if (method != http::verb::get && method != http::verb::head)
  {
    Response refusal = responseOf(http::status::method_not_allowed, PLAIN, "only GET and HEAD\n");
    refusal.set(http::field::allow, "GET, HEAD");
    return refusal;
  }
  const beast::string_view path = target.substr(0, target.find('?'));
  try
  {
    if (path == "/metrics")
    {
      return responseOf(http::status::ok, "text/plain; version=0.0.4; charset=utf-8", callbacks.metrics());
    }
    if (path == "/healthz")
    {
      return callbacks.live() ? responseOf(http::status::ok, PLAIN, "live\n")
                              : responseOf(http::status::service_unavailable, PLAIN, "not live\n");
    }
    if (path == "/readyz")
    {
      return callbacks.ready() ? responseOf(http::status::ok, PLAIN, "ready\n")
                               : responseOf(http::status::service_unavailable, PLAIN, "not ready\n");
    }
  }
  catch (const std::exception& error)
  {
    return responseOf(http::status::internal_server_error, PLAIN, std::string(error.what()) + "\n");
  }
  return responseOf(http::status::not_found, PLAIN, "there are /healthz, /readyz and /metrics\n");
}

/// Lives while anything is under way.
class Connection : public std::enable_shared_from_this<Connection>
{
public:
  Connection(tcp::socket socket, const HealthEndpoint::Callbacks& callbacks, size_t* open)
    : stream_(std::move(socket)), callbacks_(callbacks), open_(*open)
  {
    ++open_;
  }
  ~Connection() { --open_; }

  void serve(double timeout_s)
  {
    stream_.expires_after(std::chrono::nanoseconds(pi_node::nanoseconds(timeout_s)));
    parser_.header_limit(MAX_REQUEST_BYTES);
    http::async_read_header(stream_, input_, parser_,
                            [self = shared_from_this()](beast::error_code error, size_t) { self->respond(error); });
  }

private:
  void respond(beast::error_code error)
  {
    const bool is_request = !error;
    if (!is_request && error.category() != make_error_code(http::error::bad_method).category())
    {
      return;  // gone, or too late
    }
    if (error == http::error::end_of_stream)
    {
      return;
    }
    const auto& request = parser_.get();
    response_ = is_request ? answerTo(request.method(), request.target(), callbacks_)
                           : responseOf(http::status::bad_request, PLAIN, "no HTTP request\n");
    serializer_.emplace(response_);
    const auto finish = [self = shared_from_this()](beast::error_code failed, size_t)
    {
      if (!failed)
      {
        self->stream_.socket().shutdown(tcp::socket::shutdown_send, failed);
        self->discard();
      }
    };
    if (is_request && request.method() == http::verb::head)
    {
      http::async_write_header(stream_, *serializer_, finish);
      return;
    }
    http::async_write(stream_, *serializer_, finish);
  }

  /// Until the peer closes the connection or its time is over: closed with unread bytes, what was sent could be lost.
  void discard()
  {
    stream_.async_read_some(boost::asio::buffer(discarded_),
                            [self = shared_from_this()](beast::error_code error, size_t)
                            {
                              if (!error)
                              {
                                self->discard();
                              }
                            });
  }

  beast::tcp_stream stream_;
  const HealthEndpoint::Callbacks& callbacks_;
  size_t& open_;
  beast::flat_buffer input_;
  http::request_parser<http::empty_body> parser_;
  Response response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;
  std::array<char, 1024> discarded_{};
};

}  // namespace

void HealthEndpoint::Options::validate() const
{
  const pi_node::OptionCheck check("health");
  check.range<size_t>("max_connections", max_connections, 1, 10000);
  check.range("timeout_s", timeout_s, 0.01, 600.0);
}

struct HealthEndpoint::Impl
{
  Impl(const Options& options, Callbacks callbacks)
    : options(options), callbacks(std::move(callbacks)), port(options.port), acceptor(context), accept_again(context)
  {
    const pi_node::UniqueFd listener = listenOn(options.host, &port);
    sockaddr_storage address{};
    socklen_t length = sizeof address;
    getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &length);
    acceptor.assign(address.ss_family == AF_INET6 ? tcp::v6() : tcp::v4(), fcntl(listener.get(), F_DUPFD_CLOEXEC, 0));
    accept();
    thread = std::thread([this] { context.run(); });
  }
  ~Impl()
  {
    context.stop();
    thread.join();
  }

  void accept()
  {
    acceptor.async_accept(
        [this](beast::error_code error, tcp::socket socket)
        {
          if (error)
          {
            accept_again.expires_after(std::chrono::nanoseconds(pi_node::nanoseconds(ACCEPT_PAUSE_S)));
            accept_again.async_wait([this](beast::error_code) { accept(); });
            return;
          }
          if (open < options.max_connections)
          {
            std::make_shared<Connection>(std::move(socket), callbacks, &open)->serve(options.timeout_s);
          }
          accept();
        });
  }

  const Options options;
  const Callbacks callbacks;
  uint16_t port;
  size_t open = 0;                  // before the context, whose end ends the connections
  boost::asio::io_context context;  // runs on the thread alone
  tcp::acceptor acceptor;
  boost::asio::steady_timer accept_again;  // after the descriptors ran out
  std::thread thread;
};

HealthEndpoint::HealthEndpoint(const Options& options, Callbacks callbacks)
{
  options.validate();
  if (!callbacks.live || !callbacks.ready || !callbacks.metrics)
  {
    throw std::invalid_argument("health: a callback is missing, live, ready and metrics are needed");
  }
  impl_ = std::make_unique<Impl>(options, std::move(callbacks));
}

HealthEndpoint::~HealthEndpoint() = default;

uint16_t HealthEndpoint::port() const
{
  return impl_->port;
}

}  // namespace pi_offload
