#include "master/http_server.h"

#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "master/loopback_client.h"

namespace pi_os_transport
{
namespace
{

std::string post(const std::string& body)
{
  return "POST / HTTP/1.1\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
}

auto endsWith(const std::string& end)
{
  return [end](const std::string& text)
  { return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0; };
}

class HttpServerTest : public testing::Test
{
protected:
  void start(const HttpServerLimits& limits = HttpServerLimits())
  {
    server = std::make_unique<HttpServer>(
        &loop, "127.0.0.1", 0,
        [this](std::string_view body)
        {
          bodies.emplace_back(body);
          return body == "big" ? std::string(8 * 1024 * 1024, 'x') : "<" + std::string(body) + ">";
        },
        limits);
  }

  EventLoop loop;
  std::vector<std::string> bodies;
  std::unique_ptr<HttpServer> server;
};

TEST_F(HttpServerTest, AnswersRequestAfterRequestOnOneConnection)
{
  start();
  LoopbackClient client(&loop, server->port());
  for (const std::string body : {"a", "b"})
  {
    client.send(post(body));
    const std::string answer = client.receive(endsWith("<" + body + ">"));
    EXPECT_EQ(0U, answer.find("HTTP/1.1 200 OK\r\n")) << answer;
    EXPECT_NE(std::string::npos, answer.find("Content-Type: text/xml\r\n"));
  }
  EXPECT_EQ(1U, server->connections());
}

TEST_F(HttpServerTest, AnswersRequestsSentTogetherInTheirOrder)
{
  start();
  LoopbackClient client(&loop, server->port());
  std::string all;
  for (int number = 0; number < 1000; ++number)
  {
    all += post(std::to_string(number));
  }
  ASSERT_TRUE(client.send(all));
  const std::string answers = client.receive(endsWith("<999>"));
  ASSERT_EQ(1000U, bodies.size());
  for (size_t number = 0; number < bodies.size(); ++number)
  {
    EXPECT_EQ(std::to_string(number), bodies[number]);
  }
  EXPECT_LT(answers.find("<1>"), answers.find("<2>"));
}

TEST_F(HttpServerTest, ClosesWhenTheClientWantsThat)
{
  start();
  LoopbackClient client(&loop, server->port());
  client.send("POST /RPC2 HTTP/1.0\r\nContent-Length: 1\r\n\r\na");
  EXPECT_TRUE(endsWith("<a>")(client.receiveAll()));
  EXPECT_EQ(0U, server->connections());
}

TEST_F(HttpServerTest, LetsAClientSendItsBody)
{
  start();
  LoopbackClient client(&loop, server->port());
  client.send("POST / HTTP/1.1\r\nContent-Length: 1\r\nExpect: 100-continue\r\n\r\n");
  EXPECT_EQ("HTTP/1.1 100 Continue\r\n\r\n", client.receive(endsWith("\r\n\r\n")));
  client.send("a");
  client.receive(endsWith("<a>"));
}

TEST_F(HttpServerTest, RefusesWhatItDoesNotServe)
{
  HttpServerLimits limits;
  limits.message.body_bytes = 100;
  start(limits);
  const std::vector<std::pair<std::string, std::string>> cases{
      {"GET / HTTP/1.1\r\n\r\n", " 501 "}, {"POST /other HTTP/1.1\r\nContent-Length: 0\r\n\r\n", " 404 "},
      {"nonsense\r\n", " 400 "},           {post(std::string(101, 'x')), " 413 "},
      {std::string(20000, 'x'), " 431 "},
  };
  for (const auto& [request, status] : cases)
  {
    LoopbackClient client(&loop, server->port());
    client.send(request);
    const std::string answer = client.receiveAll();
    EXPECT_NE(std::string::npos, answer.substr(0, 20).find(status)) << answer;
  }
  EXPECT_EQ(0U, server->connections());
  EXPECT_TRUE(bodies.empty());
}

TEST_F(HttpServerTest, EndsASlowRequest)
{
  HttpServerLimits limits;
  limits.request = std::chrono::milliseconds(50);
  start(limits);
  LoopbackClient client(&loop, server->port());
  client.send("POST / HT");
  EXPECT_NE(std::string::npos, client.receiveAll().find(" 408 "));
}

TEST_F(HttpServerTest, KeepsAQuietConnection)
{
  HttpServerLimits limits;
  limits.request = std::chrono::milliseconds(1);
  start(limits);
  LoopbackClient client(&loop, server->port());
  client.send(post("a"));
  client.receive(endsWith("<a>"));
  bool is_later = false;
  loop.at(SteadyClock::now() + std::chrono::milliseconds(20), [&] { is_later = true; });
  ASSERT_TRUE(runUntil(&loop, [&] { return is_later; }));
  client.send(post("b"));
  client.receive(endsWith("<b>"));
}

TEST_F(HttpServerTest, DropsWhoDoesNotReadWithoutDelayingOthers)
{
  HttpServerLimits limits;
  limits.reply = std::chrono::milliseconds(300);
  start(limits);
  LoopbackClient deaf(&loop, server->port());
  deaf.send(post("big"));
  ASSERT_TRUE(runUntil(&loop, [&] { return bodies.size() == 1; }));
  LoopbackClient client(&loop, server->port());
  client.send(post("a"));
  client.receive(endsWith("<a>"));
  EXPECT_EQ(2U, server->connections());
  EXPECT_TRUE(runUntil(&loop, [&] { return server->connections() == 1; }));
}

TEST_F(HttpServerTest, SendsABigAnswerInParts)
{
  start();
  LoopbackClient client(&loop, server->port());
  client.send(post("big"));
  size_t size = 0;
  client.receive(
      [&](const std::string& received)
      {
        size = received.size();
        return size > 8 * 1024 * 1024;
      });
  EXPECT_GT(size, 8U * 1024 * 1024);
  client.send(post("a"));
  client.receive(endsWith("<a>"));
}

TEST_F(HttpServerTest, LimitsWhatAllRequestsTakeTogether)
{
  HttpServerLimits limits;
  limits.bytes_in = 100000;
  start(limits);
  LoopbackClient first(&loop, server->port());
  first.send("POST / HTTP/1.1\r\nContent-Length: 90000\r\n\r\n" + std::string(60000, 'x'));
  LoopbackClient other(&loop, server->port());
  for (int count = 0; count < 20; ++count)  // in each of which the server reads more of the first
  {
    other.send(post("a"));
    other.receive(endsWith("<a>"));
  }
  LoopbackClient second(&loop, server->port());
  second.send("POST / HTTP/1.1\r\nContent-Length: 90000\r\n\r\n" + std::string(60000, 'x'));
  EXPECT_NE(std::string::npos, second.receiveAll().find(" 503 "));
  first.send(std::string(30000, 'x'));
  first.receive(endsWith(">"));
  EXPECT_EQ(90000U, bodies.back().size());
}

TEST_F(HttpServerTest, MakesRoomByDroppingTheLongestSilent)
{
  HttpServerLimits limits;
  limits.connections = 2;
  start(limits);
  LoopbackClient first(&loop, server->port());
  LoopbackClient second(&loop, server->port());
  for (LoopbackClient* client : {&second, &first})
  {
    client->send(post("a"));
    client->receive(endsWith("<a>"));
  }
  LoopbackClient third(&loop, server->port());
  third.send(post("b"));
  third.receive(endsWith("<b>"));
  EXPECT_EQ("", second.receiveAll());
  first.send(post("c"));
  first.receive(endsWith("<c>"));
}

TEST_F(HttpServerTest, NamesThePortThatIsInUse)
{
  start();
  try
  {
    const HttpServer other(&loop, "127.0.0.1", server->port(), [](std::string_view) { return std::string(); });
    FAIL() << "two servers on one port";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_NE(std::string::npos, std::string(error.what()).find(std::to_string(server->port()))) << error.what();
    EXPECT_NE(std::string::npos, std::string(error.what()).find("-p")) << error.what();
  }
}

}  // namespace
}  // namespace pi_os_transport
