#include "server/connection_over.h"

#include <dlfcn.h>

#include <filesystem>

namespace pi_web
{
namespace
{

class PlainConnections : public ConnectionMaker
{
public:
  std::shared_ptr<Connection> make(boost::asio::ip::tcp::socket socket, WebServer* server) override
  {
    return std::make_shared<ConnectionOver<beast::tcp_stream>>(server, std::move(socket));
  }
};

}  // namespace

std::string chosenProtocol(beast::string_view offered)
{
  for (const char* const protocol : SUBPROTOCOLS)
  {
    for (const auto& one : http::token_list(offered))
    {
      if (one == protocol)
      {
        return protocol;
      }
    }
  }
  return "";
}

int64_t connectionNowNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::unique_ptr<ConnectionMaker> plainConnections()
{
  return std::make_unique<PlainConnections>();
}

std::unique_ptr<ConnectionMaker> tlsConnections(const std::string& folder)
{
  Dl_info here{};
  dladdr(MAKE_TLS_CONNECTIONS, &here);
  const std::string library = std::filesystem::path(here.dli_fname).replace_filename("libpi_web_tls.so").string();
  void* const loaded = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  void* const make = loaded != nullptr ? dlsym(loaded, MAKE_TLS_CONNECTIONS) : nullptr;
  if (make == nullptr)
  {
    throw std::runtime_error("tls_folder: the library of TLS cannot be loaded (" + std::string(dlerror()) +
                             "); install pi_web again, or leave tls_folder empty");
  }
  return std::unique_ptr<ConnectionMaker>(reinterpret_cast<MakeTlsConnections*>(make)(folder.c_str()));
}

}  // namespace pi_web
