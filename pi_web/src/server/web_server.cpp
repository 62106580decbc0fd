#include "server/web_server.h"

#include "server/connection.h"

#include <boost/asio/ip/address.hpp>
#include <boost/asio/socket_base.hpp>
#include <stdexcept>
#include <utility>

namespace pi_web
{
namespace
{

using boost::asio::ip::tcp;

constexpr size_t SPARE_CONNECTIONS = 64;                       // that load files, beside the clients
constexpr auto ACCEPT_AGAIN = std::chrono::milliseconds(200);  // after the descriptors ran out

}  // namespace

WebServer::WebServer(boost::asio::io_context* context, const WebServerOptions& options,
                     std::map<std::string, WebFile> files, ClientHandler* handler, Log log)
  : context_(context)
  , options_(options)
  , files_(std::move(files))
  , handler_(handler)
  , log_(std::move(log))
  , maker_(options.tls_folder.empty() ? plainConnections() : tlsConnections(options.tls_folder))
  , acceptor_(*context)
  , accept_again_(*context)
{
  try
  {
    const tcp::endpoint endpoint(boost::asio::ip::make_address(options.address),
                                 static_cast<unsigned short>(options.port));
    acceptor_.open(endpoint.protocol());
    acceptor_.set_option(boost::asio::socket_base::reuse_address(true));
    acceptor_.bind(endpoint);
    acceptor_.listen();
  }
  catch (const boost::system::system_error& error)
  {
    throw std::runtime_error("address " + options.address + ", port " + std::to_string(options.port) + ": " +
                             error.code().message() + "; choose others, or end what listens there");
  }
  accept();
}

WebServer::~WebServer()
{
  for (Connection* const connection : connections_)
  {
    connection->abandon();
  }
}

void WebServer::accept()
{
  acceptor_.async_accept(
      [this](const boost::system::error_code& error, tcp::socket socket)
      {
        if (error == boost::asio::error::operation_aborted)
        {
          return;
        }
        if (error)
        {
          log_("a connection is not accepted: " + error.message());
          accept_again_.expires_after(ACCEPT_AGAIN);
          accept_again_.async_wait(
              [this](const boost::system::error_code& cancelled)
              {
                if (!cancelled)
                {
                  accept();
                }
              });
          return;
        }
        if (connections_.size() < static_cast<size_t>(options_.max_clients) + SPARE_CONNECTIONS)
        {
          maker_->make(std::move(socket), this)->start();
        }
        else
        {
          log_("a connection is refused: " + std::to_string(connections_.size()) + " are open");
        }
        accept();
      });
}

}  // namespace pi_web
