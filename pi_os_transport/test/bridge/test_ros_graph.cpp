#include "bridge/ros_graph.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "master/http_server.h"
#include "master/listener.h"
#include "master/master_api.h"
#include "master/rpc_encoder.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

/// A program that answers the first part of a TCPROS connection with a fixed header, or says nothing.
class FakeServer
{
public:
  FakeServer(EventLoop* loop, TcprosHeader answer)
    : loop_(loop), answer_(std::move(answer)), listener_(loop, "0.0.0.0", 0)
  {
    listener_.start(
        [this](FileDescriptor connection)
        {
          connections_.push_back(std::move(connection));
          loop_->add(connections_.back().get(), EPOLLIN,
                     [this, fd = connections_.back().get()](uint32_t) { read(fd); });
        },
        [] { return false; });
  }
  ~FakeServer()
  {
    for (const FileDescriptor& connection : connections_)
    {
      loop_->remove(connection.get());
    }
  }
  uint16_t port() const { return listener_.port(); }
  size_t connections() const { return connections_.size(); }
  const std::vector<TcprosHeader>& asked() const { return asked_; }

private:
  void read(int fd)
  {
    char bytes[1000];
    const ssize_t count = recv(fd, bytes, sizeof(bytes), 0);
    if (count <= 0)
    {
      loop_->remove(fd);
      return;
    }
    TcprosReader reader(sizeof(bytes));
    reader.feed(std::string_view(bytes, static_cast<size_t>(count)));
    asked_.push_back(decodeTcprosHeader(*reader.next()).value_or(TcprosHeader()));
    const std::string answer = encodeTcprosHeader(answer_);
    if (!answer_.empty())
    {
      send(fd, answer.data(), answer.size(), MSG_NOSIGNAL);
    }
  }

  EventLoop* loop_;
  TcprosHeader answer_;
  Listener listener_;
  std::vector<FileDescriptor> connections_;
  std::vector<TcprosHeader> asked_;
};

const TcprosHeader SERVICE_HEADER{{"callerid", "/server"}, {"md5sum", "0123"}, {"type", "a/B"}};

class RosGraphTest : public testing::Test
{
protected:
  RosGraphTest()
    : calls_(&loop_)
    , server_(&loop_, "127.0.0.1", 0, [this](std::string_view request) { return api_->answer(request); })
    , uri_(httpUri("127.0.0.1", server_.port()))
  {
    api_.emplace(uri_, &calls_, [](const std::string&) {});
    graph_ = std::make_unique<RosGraph>(&loop_, uri_);
  }

  void registerService(const std::string& name, const std::string& host, uint16_t port)
  {
    api_->answer(encodeRpcCall(
        "registerService", {"/server", name, "rosrpc://" + host + ":" + std::to_string(port), "http://127.0.0.1:1/"}));
  }
  /// @return the refusal, "" for none
  std::string service(const std::string& name, uint16_t port, const std::string& address = "127.0.0.1")
  {
    std::optional<std::string> answer;
    graph_->findService(name, Endpoint{address, port}, [&](const std::string& refusal) { answer = refusal; });
    return await(&answer);
  }
  std::string device(const std::string& address)
  {
    std::optional<std::string> answer;
    graph_->findDevice(address, [&](const std::string& refusal) { answer = refusal; });
    return await(&answer);
  }
  std::string await(const std::optional<std::string>* answer)
  {
    const SteadyTime end = SteadyClock::now() + std::chrono::seconds(30);
    while (!*answer && SteadyClock::now() < end)
    {
      loop_.runOnce(std::chrono::milliseconds(10));
    }
    return answer->value_or("no answer");
  }

  EventLoop loop_;
  NodeCaller calls_;
  std::optional<MasterApi> api_;
  HttpServer server_;
  const std::string uri_;
  std::unique_ptr<RosGraph> graph_;
};

TEST_F(RosGraphTest, FindsARegisteredServiceThatAnswers)
{
  FakeServer server(&loop_, SERVICE_HEADER);
  registerService("/add", "localhost", server.port());
  EXPECT_EQ("", service("/add", server.port()));
  ASSERT_EQ(1U, server.asked().size());
  EXPECT_EQ("/add", server.asked()[0].at("service"));
  EXPECT_EQ("*", server.asked()[0].at("md5sum"));
  EXPECT_EQ("", service("/add", server.port()));
  EXPECT_EQ(1U, server.asked().size()) << "a yes holds for a while";
}

TEST_F(RosGraphTest, APortThatIsNoServiceIsNotEvenTouched)
{
  FakeServer server(&loop_, SERVICE_HEADER);
  FakeServer other(&loop_, SERVICE_HEADER);
  registerService("/add", "localhost", server.port());
  EXPECT_EQ("/add is registered at another port with the ROS master at " + uri_, service("/add", other.port()));
  EXPECT_EQ("/subtract is not registered with the ROS master at " + uri_, service("/subtract", server.port()));
  EXPECT_EQ(0U, server.connections() + other.connections());
}

TEST_F(RosGraphTest, AServiceOfAnotherDeviceIsNotHere)
{
  FakeServer server(&loop_, SERVICE_HEADER);
  registerService("/add", "192.0.2.7", server.port());
  EXPECT_EQ("/add is registered at 192.0.2.7, which is not this device", service("/add", server.port()));
}

TEST_F(RosGraphTest, AStaleRegistrationOpensNothing)
{
  uint16_t port = 0;
  {
    FakeServer server(&loop_, SERVICE_HEADER);
    port = server.port();
    registerService("/add", "localhost", port);
  }
  const std::string refusal = "nobody serves /add at 127.0.0.1:" + std::to_string(port) + " any more";
  EXPECT_EQ(refusal, service("/add", port));
}

TEST_F(RosGraphTest, AnotherProgramAtARegisteredPortIsNoService)
{
  FakeServer silent(&loop_, {});
  registerService("/silent", "localhost", silent.port());
  EXPECT_EQ(0U, service("/silent", silent.port()).find("nobody serves /silent"));
  FakeServer refuses(&loop_, {{"error", "no such service"}});
  registerService("/refuses", "localhost", refuses.port());
  EXPECT_EQ(0U, service("/refuses", refuses.port()).find("nobody serves /refuses"));
}

TEST_F(RosGraphTest, NamesThatAreNoneAreNotAskedFor)
{
  for (const char* const name : {"add", "/", "/a b", "/a\nb", "/a=b", "/\xc3\xa4"})
  {
    EXPECT_EQ("the name of the service is not valid", service(name, 1)) << name;
  }
  EXPECT_EQ("the other bridge names no service: it is of an older build", service("", 1));
  EXPECT_EQ("the name of the service is not valid", service("/" + std::string(300, 'a'), 1));
}

TEST_F(RosGraphTest, FindsTheDevicesOfRegisteredNodes)
{
  api_->addPublisher("/camera", "/image", "a/B", "http://192.0.2.1:4000/");
  api_->addSubscriber("/viewer", "/image", "a/B", "http://192.0.2.2:4000/");
  EXPECT_EQ("", device("192.0.2.1"));
  EXPECT_EQ("", device("192.0.2.2"));
  EXPECT_EQ("no node of it is registered with the ROS master at " + uri_, device("192.0.2.3"));
  api_->addSubscriber("/late", "/image", "a/B", "http://192.0.2.3:4000/");
  EXPECT_EQ("", device("192.0.2.3"));
}

TEST_F(RosGraphTest, AMasterThatDoesNotAnswerKnowsNothing)
{
  RosGraph none(&loop_, "http://127.0.0.1:1");
  std::optional<std::string> answer;
  none.findDevice("192.0.2.1", [&](const std::string& refusal) { answer = refusal; });
  EXPECT_EQ("the ROS master at http://127.0.0.1:1 does not answer", await(&answer));
  answer.reset();
  none.findService("/add", Endpoint{"127.0.0.1", 1}, [&](const std::string& refusal) { answer = refusal; });
  EXPECT_EQ("/add is not registered with the ROS master at http://127.0.0.1:1", await(&answer));
}

TEST_F(RosGraphTest, StrangersCannotAskWithoutBound)
{
  size_t refused = 0;
  size_t answered = 0;
  for (int i = 0; i < 1000; ++i)
  {
    graph_->findDevice("198.51.100." + std::to_string(i),
                       [&](const std::string& refusal)
                       {
                         ++answered;
                         refused += refusal == "too many unknown devices knock" ? 1 : 0;
                       });
  }
  EXPECT_EQ(1000U - 64U, refused);
  const SteadyTime end = SteadyClock::now() + std::chrono::seconds(30);
  while (answered < 1000 && SteadyClock::now() < end)
  {
    loop_.runOnce(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(1000U, answered);
}

}  // namespace
}  // namespace pi_os_transport
