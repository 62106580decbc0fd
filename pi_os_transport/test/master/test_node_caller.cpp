#include "master/node_caller.h"

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "master/http_server.h"
#include "master/loopback_client.h"
#include "master/rpc_encoder.h"

namespace pi_os_transport
{
namespace
{

/// A node whose slave API answers every call, and remembers it.
struct FakeNode
{
  explicit FakeNode(EventLoop* loop)
    : server(loop, "127.0.0.1", 0,
             [this](std::string_view body)
             {
               const RpcCall call = decodeRpcCall(body);
               methods.push_back(call.method);
               return encodeRpcResponse(RpcValue::Array{1, "", call.params.at(0)});
             })
  {
  }
  std::string uri() const { return httpUri("localhost", server.port()); }

  std::vector<std::string> methods;
  HttpServer server;
};

/// A node that accepts connections, through the kernel, and says nothing.
struct HungNode
{
  explicit HungNode(EventLoop* loop) : listener(loop, "127.0.0.1", 0) {}
  std::string uri() const { return httpUri("127.0.0.1", listener.port()); }
  Listener listener;
};

class NodeCallerTest : public testing::Test
{
protected:
  void start(const NodeCallerLimits& limits = NodeCallerLimits())
  {
    caller = std::make_unique<NodeCaller>(&loop, limits);
  }
  /// @param subject  "": none
  void call(const std::string& api, const std::string& method, const std::string& subject = "")
  {
    caller->call(
        api, {std::make_shared<const std::string>(encodeRpcCall(method, {"argument"})), subject,
              [this](const RpcResponse* response)
              { answers.push_back(response != nullptr ? std::optional<RpcValue>(response->value) : std::nullopt); }});
  }
  bool awaitAnswers(size_t count)
  {
    return runUntil(&loop, [&] { return answers.size() >= count; });
  }

  EventLoop loop;
  std::unique_ptr<NodeCaller> caller;
  std::vector<std::optional<RpcValue>> answers;
};

TEST_F(NodeCallerTest, CallsOneAfterTheOtherOverOneConnection)
{
  start();
  FakeNode node(&loop);
  for (const char* method : {"a", "b", "c"})
  {
    call(node.uri(), method);
  }
  ASSERT_TRUE(awaitAnswers(3));
  EXPECT_EQ((std::vector<std::string>{"a", "b", "c"}), node.methods);
  EXPECT_EQ(RpcValue(RpcValue::Array{1, "", "argument"}), answers[0]);
  EXPECT_EQ(1U, node.server.connections());
}

TEST_F(NodeCallerTest, DropsTheConnectionWhenNothingIsLeftToCall)
{
  NodeCallerLimits limits;
  limits.idle = std::chrono::milliseconds(1);
  start(limits);
  FakeNode node(&loop);
  call(node.uri(), "a");
  ASSERT_TRUE(awaitAnswers(1));
  ASSERT_TRUE(runUntil(&loop, [&] { return caller->nodes() == 0 && node.server.connections() == 0; }));
  call(node.uri(), "b");
  ASSERT_TRUE(awaitAnswers(2));
  EXPECT_TRUE(answers[1].has_value());
}

TEST_F(NodeCallerTest, ReplacesQueuedCallsOfTheSameSubject)
{
  start();
  FakeNode node(&loop);
  call(node.uri(), "t1", "topic t");
  call(node.uri(), "u1", "topic u");
  call(node.uri(), "t2", "topic t");
  call(node.uri(), "x");
  call(node.uri(), "t3", "topic t");
  ASSERT_TRUE(awaitAnswers(3));
  EXPECT_EQ((std::vector<std::string>{"u1", "x", "t3"}), node.methods);
}

TEST_F(NodeCallerTest, SendsANewerCallAfterTheOneUnderWay)
{
  start();
  std::unique_ptr<FakeNode> node = std::make_unique<FakeNode>(&loop);
  call(node->uri(), "t1", "topic t");
  ASSERT_TRUE(runUntil(&loop, [&] { return !node->methods.empty(); }));
  call(node->uri(), "t2", "topic t");
  ASSERT_TRUE(awaitAnswers(2));
  EXPECT_EQ((std::vector<std::string>{"t1", "t2"}), node->methods);
}

TEST_F(NodeCallerTest, TellsThatNobodyAnswers)
{
  start();
  auto gone = std::make_unique<HungNode>(&loop);
  const std::string uri = gone->uri();
  gone.reset();
  call(uri, "a");
  call(uri, "b");
  call("http://no.such.host.invalid:1/", "a");
  call("rosrpc://a:1", "a");
  ASSERT_TRUE(awaitAnswers(4));
  for (const std::optional<RpcValue>& answer : answers)
  {
    EXPECT_FALSE(answer.has_value());
  }
  EXPECT_TRUE(runUntil(&loop, [&] { return caller->nodes() == 0; }));
}

TEST_F(NodeCallerTest, DoesNotLetAHungNodeDelayOthers)
{
  start();
  const HungNode hung(&loop);
  FakeNode node(&loop);
  call(hung.uri(), "a");
  for (int count = 0; count < 10; ++count)
  {
    call(node.uri(), "b");
  }
  ASSERT_TRUE(awaitAnswers(10));
  EXPECT_EQ(10U, node.methods.size());
  EXPECT_EQ(1U, caller->nodes() - 1);  // the hung one beside the other's idle connection
}

TEST_F(NodeCallerTest, GivesUpANodeThatDoesNotAnswer)
{
  NodeCallerLimits limits;
  limits.reply = std::chrono::milliseconds(20);
  start(limits);
  const HungNode hung(&loop);
  call(hung.uri(), "a");
  call(hung.uri(), "b");
  ASSERT_TRUE(awaitAnswers(2));
  EXPECT_FALSE(answers[0].has_value());
  EXPECT_FALSE(answers[1].has_value());
}

TEST_F(NodeCallerTest, TakesConnectionsFromHungNodesWhenOthersWait)
{
  NodeCallerLimits limits;
  limits.connections = 2;
  limits.patience = std::chrono::milliseconds(20);
  start(limits);
  const HungNode first(&loop);
  const HungNode second(&loop);
  FakeNode node(&loop);
  call(first.uri(), "a");
  call(second.uri(), "a");
  call(node.uri(), "b");
  ASSERT_TRUE(runUntil(&loop, [&] { return node.methods.size() == 1; }));
}

TEST_F(NodeCallerTest, ConnectsAnewWhenTheNodeHasClosedTheConnection)
{
  start();
  auto node = std::make_unique<FakeNode>(&loop);
  const uint16_t port = node->server.port();
  const std::string uri = node->uri();
  call(uri, "a");
  ASSERT_TRUE(awaitAnswers(1));
  node.reset();
  std::vector<std::string> methods;
  const HttpServer successor(&loop, "127.0.0.1", port,
                             [&](std::string_view body)
                             {
                               methods.push_back(decodeRpcCall(body).method);
                               return encodeRpcResponse(1);
                             });
  call(uri, "b");
  ASSERT_TRUE(awaitAnswers(2));
  EXPECT_EQ((std::vector<std::string>{"b"}), methods);
  EXPECT_EQ(RpcValue(1), answers[1]);
}

TEST_F(NodeCallerTest, TakesNonsenseForNoAnswer)
{
  start();
  const HttpServer server(&loop, "127.0.0.1", 0, [](std::string_view) { return std::string("nonsense"); });
  call(httpUri("127.0.0.1", server.port()), "a");
  ASSERT_TRUE(awaitAnswers(1));
  EXPECT_FALSE(answers[0].has_value());
}

}  // namespace
}  // namespace pi_os_transport
