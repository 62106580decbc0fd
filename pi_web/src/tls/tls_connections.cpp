#include "server/connection_over.h"

#include <unistd.h>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/verify_mode.hpp>
#include <boost/beast/ssl.hpp>

#include <cerrno>
#include <cstring>
#include <filesystem>

// A library of its own, which the server loads when it is to speak TLS.

namespace pi_web
{
namespace
{

namespace ssl = boost::asio::ssl;
using TlsStream = beast::ssl_stream<beast::tcp_stream>;

/// @throws std::runtime_error naming the file.
ssl::context contextOf(const std::filesystem::path& folder)
{
  ssl::context context(ssl::context::tls_server);
  context.set_options(ssl::context::default_workarounds | ssl::context::no_tlsv1 | ssl::context::no_tlsv1_1);
  std::filesystem::path file = folder / "certificate.pem";
  try
  {
    context.use_certificate_chain_file(file.string());
    file = folder / "key.pem";
    context.use_private_key_file(file.string(), ssl::context::pem);
    file = folder / "ca.pem";
    if (std::filesystem::exists(file))
    {
      context.load_verify_file(file.string());
      context.set_verify_mode(ssl::verify_peer);  // who has none may still have the token
    }
  }
  catch (const boost::system::system_error& error)
  {
    const bool readable = access(file.c_str(), R_OK) == 0;
    throw std::runtime_error(
        "tls_folder: " + file.string() + ": " +
        (readable ? "it is no PEM, or does not belong to the certificate (" + error.code().message() + ")"
                  : std::string(std::strerror(errno))) +
        "; pi_edge fleet makes such folders");
  }
  return context;
}

/// Whether the client showed an operator's certificate of our authority; a wrong one has ended the handshake.
bool isOperator(SSL* tls)
{
  X509* const certificate = SSL_get_peer_certificate(tls);
  char unit[32] = {};
  if (certificate != nullptr)
  {
    X509_NAME_get_text_by_NID(X509_get_subject_name(certificate), NID_organizationalUnitName, unit, sizeof unit);
    X509_free(certificate);
  }
  return std::string_view(unit) == "operator";
}

class TlsConnection : public ConnectionOver<TlsStream>
{
public:
  using ConnectionOver<TlsStream>::ConnectionOver;

  void start() override
  {
    lowest().expires_after(HTTP_LIMIT);
    socket_.next_layer().async_handshake(
        ssl::stream_base::server, [self = std::static_pointer_cast<TlsConnection>(self())](beast::error_code error)
        { self->onHandshake(error); });
  }

private:
  void onHandshake(beast::error_code error)
  {
    if (server_ == nullptr)
    {
      return;
    }
    if (error)
    {
      log(name_ + " is refused: TLS: " + error.message());
      return;
    }
    certified_ = isOperator(socket_.next_layer().native_handle());
    readHttp();
  }
};

class TlsConnections : public ConnectionMaker
{
public:
  explicit TlsConnections(const std::filesystem::path& folder) : context_(contextOf(folder)) {}

  std::shared_ptr<Connection> make(boost::asio::ip::tcp::socket socket, WebServer* server) override
  {
    return std::make_shared<TlsConnection>(server, std::move(socket), context_);
  }

private:
  ssl::context context_;
};

}  // namespace
}  // namespace pi_web

extern "C" pi_web::ConnectionMaker* piWebMakeTlsConnections(const char* folder)
{
  return new pi_web::TlsConnections(folder);
}
