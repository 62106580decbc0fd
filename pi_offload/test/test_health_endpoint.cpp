#include "server/health_endpoint.h"

#include <gtest/gtest.h>

#include <atomic>
#include <random>

#include "raw_socket.h"

using namespace pi_offload;

namespace
{

struct Server
{
  explicit Server(double timeout_s = 20.0, size_t max_connections = 4)
  {
    HealthEndpoint::Options options;
    options.host = "127.0.0.1";
    options.timeout_s = timeout_s;
    options.max_connections = max_connections;
    HealthEndpoint::Callbacks callbacks;
    callbacks.live = [this] { return live.load(); };
    callbacks.ready = [this] { return ready.load(); };
    callbacks.metrics = [this]
    {
      if (!live)
      {
        throw std::runtime_error("nothing to tell");
      }
      return std::string(300000, 'm');
    };
    endpoint = std::make_unique<HealthEndpoint>(options, callbacks);
  }
  std::string ask(const std::string& request)
  {
    RawSocket socket = RawSocket::connectTo(endpoint->port());
    socket.write(request);
    return socket.readAll();
  }
  std::atomic<bool> live{true};
  std::atomic<bool> ready{true};
  std::unique_ptr<HealthEndpoint> endpoint;
};

std::string firstLine(const std::string& text)
{
  return text.substr(0, text.find('\r'));
}

}  // namespace

TEST(HealthEndpoint, AnswersProbes)
{
  Server server;
  EXPECT_EQ(server.ask("GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n"),
            "HTTP/1.1 200 OK\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: 5\r\nConnection: "
            "close\r\n\r\nlive\n");
  EXPECT_EQ(firstLine(server.ask("GET /readyz?verbose=1 HTTP/1.0\r\n\r\n")), "HTTP/1.1 200 OK");
  server.ready = false;
  EXPECT_EQ(firstLine(server.ask("GET /readyz HTTP/1.1\r\n\r\n")), "HTTP/1.1 503 Service Unavailable");
  EXPECT_EQ(firstLine(server.ask("GET /healthz HTTP/1.1\r\n\r\n")), "HTTP/1.1 200 OK");
  server.live = false;
  EXPECT_EQ(firstLine(server.ask("GET /healthz HTTP/1.1\r\n\r\n")), "HTTP/1.1 503 Service Unavailable");
}

TEST(HealthEndpoint, GivesMetricsWhole)
{
  Server server;
  const std::string all = server.ask("GET /metrics HTTP/1.1\r\n\r\n");
  EXPECT_NE(all.find("text/plain; version=0.0.4"), std::string::npos);
  EXPECT_NE(all.find("Content-Length: 300000\r\n"), std::string::npos);
  EXPECT_EQ(all.size() - all.find("\r\n\r\n") - 4, 300000U);
  const std::string head = server.ask("HEAD /metrics HTTP/1.1\r\n\r\n");
  EXPECT_EQ(head.size(), head.find("\r\n\r\n") + 4);
  EXPECT_NE(head.find("Content-Length: 300000\r\n"), std::string::npos);
  server.live = false;
  const std::string failed = server.ask("GET /metrics HTTP/1.1\r\n\r\n");
  EXPECT_EQ(firstLine(failed), "HTTP/1.1 500 Internal Server Error");
  EXPECT_NE(failed.find("nothing to tell"), std::string::npos);
}

TEST(HealthEndpoint, RefusesOtherRequests)
{
  Server server;
  EXPECT_EQ(firstLine(server.ask("GET / HTTP/1.1\r\n\r\n")), "HTTP/1.1 404 Not Found");
  EXPECT_EQ(firstLine(server.ask("POST /metrics HTTP/1.1\r\n\r\n")), "HTTP/1.1 405 Method Not Allowed");
  EXPECT_EQ(firstLine(server.ask("hello\r\n\r\n")), "HTTP/1.1 400 Bad Request");
  EXPECT_EQ(firstLine(server.ask(std::string(10000, 'a'))), "HTTP/1.1 400 Bad Request");
}

TEST(HealthEndpoint, TakesARequestInPieces)
{
  Server server;
  RawSocket socket = RawSocket::connectTo(server.endpoint->port());
  for (const char letter : std::string("GET /readyz HTTP/1.1\r\n\r\n"))
  {
    ASSERT_TRUE(socket.write(std::string(1, letter)));
  }
  EXPECT_EQ(firstLine(socket.readAll()), "HTTP/1.1 200 OK");
}

TEST(HealthEndpoint, ClosesWhoSaysNothingAndWhoIsTooMany)
{
  Server server(0.1, 2);
  RawSocket silent = RawSocket::connectTo(server.endpoint->port());
  RawSocket slow = RawSocket::connectTo(server.endpoint->port());
  slow.write("GET /he");
  RawSocket third = RawSocket::connectTo(server.endpoint->port());
  EXPECT_TRUE(third.closes());
  EXPECT_TRUE(silent.closes());
  EXPECT_TRUE(slow.closes());
  EXPECT_EQ(firstLine(server.ask("GET /healthz HTTP/1.1\r\n\r\n")), "HTTP/1.1 200 OK");
}

TEST(HealthEndpoint, RandomBytesDoNotEndIt)
{
  Server server(20.0, 1000);
  std::mt19937 random(4);
  for (int round = 0; round < 200; ++round)
  {
    std::string bytes = round % 2 == 0 ? "GET /metrics HTTP/1.1\r\n\r\n" : "";
    for (unsigned count = random() % 500; count > 0; --count)
    {
      bytes.push_back(static_cast<char>(random()));
    }
    RawSocket socket = RawSocket::connectTo(server.endpoint->port());
    socket.write(bytes);
  }
  EXPECT_EQ(firstLine(server.ask("GET /healthz HTTP/1.1\r\n\r\n")), "HTTP/1.1 200 OK");
}

TEST(HealthEndpoint, SaysWhatIsWrongWithItsOptions)
{
  HealthEndpoint::Options options;
  options.host = "127.0.0.1";
  EXPECT_THROW(HealthEndpoint(options, {}), std::invalid_argument);
  options.timeout_s = -1.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  Server server;
  options.timeout_s = 1.0;
  options.port = server.endpoint->port();
  HealthEndpoint::Callbacks callbacks;
  callbacks.live = callbacks.ready = [] { return true; };
  callbacks.metrics = [] { return std::string(); };
  EXPECT_THROW(HealthEndpoint(options, callbacks), std::runtime_error);
}
