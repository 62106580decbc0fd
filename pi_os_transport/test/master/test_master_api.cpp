#include "master/master_api.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <string>
#include <utility>
#include <vector>

#include "master/rpc_decoder.h"
#include "master/rpc_encoder.h"

namespace pi_os_transport
{
namespace
{

const std::string NODE = "/ns/node";
const std::string API = "http://a:1/";
const std::string SUBSCRIBER_API = "http://b:2/";

class MasterApiTest : public testing::Test, protected NodeCalls
{
protected:
  struct Told
  {
    std::string api;
    RpcCall call;
    NodeCall::Done done;
  };
  void call(const std::string& api, NodeCall call) override
  {
    RpcCall decoded = decodeRpcCall(*call.body);
    std::vector<Told>& list = decoded.method == "getPid" ? asked : told;
    list.push_back({api, std::move(decoded), std::move(call.done)});
  }
  /// The last node that was asked for its process answers.
  void answerPid(int pid)
  {
    RpcResponse response;
    response.value = RpcValue::Array{1, "", pid};
    const NodeCall::Done done = asked.back().done;
    done(&response);
  }

  RpcResponse respond(const std::string& method, const RpcValue::Array& params)
  {
    return decodeRpcResponse(api.answer(encodeRpcCall(method, params)));
  }
  RpcValue::Array result(const std::string& method, const RpcValue::Array& params)
  {
    const RpcResponse response = respond(method, params);
    EXPECT_FALSE(response.is_fault) << method;
    return response.value.as<RpcValue::Array>();
  }

  std::vector<Told> told;
  std::vector<Told> asked;  ///< for their process
  std::string shut_down_reason;
  MasterApi api{"http://master:11311/", this, [this](const std::string& reason) { shut_down_reason = reason; }};
};

TEST_F(MasterApiTest, TellsAboutItself)
{
  EXPECT_EQ((RpcValue::Array{1, "", "http://master:11311/"}), result("getUri", {NODE}));
  EXPECT_EQ((RpcValue::Array{1, "", getpid()}), result("getPid", {NODE}));
  EXPECT_EQ((RpcValue::Array{1, "shutdown", 0}), result("shutdown", {NODE, "why"}));
  EXPECT_NE(std::string::npos, shut_down_reason.find("[/ns/node]: why"));
}

TEST_F(MasterApiTest, TellsSubscribersOfPublishers)
{
  EXPECT_EQ((RpcValue::Array{1, "Subscribed to [/ns/t]", RpcValue::Array()}),
            result("registerSubscriber", {NODE, "t", "std_msgs/String", SUBSCRIBER_API}));
  EXPECT_EQ((RpcValue::Array{1, "Registered [/pub] as publisher of [/ns/t]", RpcValue::Array{SUBSCRIBER_API}}),
            result("registerPublisher", {"/pub", "/ns/t", "std_msgs/String", API}));
  EXPECT_EQ((RpcValue::Array{1, "Unregistered [/pub] as provider of [/ns/t]", 1}),
            result("unregisterPublisher", {"/pub", "/ns/t", API}));
  EXPECT_EQ((RpcValue::Array{1, "[/pub] is not a registered node", 0}),
            result("unregisterPublisher", {"/pub", "/ns/t", API}));
  ASSERT_EQ(2U, told.size());
  EXPECT_EQ(SUBSCRIBER_API, told[0].api);
  EXPECT_EQ("publisherUpdate", told[0].call.method);
  EXPECT_EQ((RpcValue::Array{"/master", "/ns/t", RpcValue::Array{API}}), told[0].call.params);
  EXPECT_EQ((RpcValue::Array{"/master", "/ns/t", RpcValue::Array()}), told[1].call.params);
}

TEST_F(MasterApiTest, ShutsTheOldProcessOfANodeDown)
{
  result("registerPublisher", {NODE, "/t", "std_msgs/String", API});
  result("registerSubscriber", {"/sub", "/t", "*", SUBSCRIBER_API});
  result("registerPublisher", {NODE, "/u", "std_msgs/String", "http://new:3/"});
  ASSERT_EQ(2U, told.size());
  EXPECT_EQ(API, told[0].api);
  EXPECT_EQ("shutdown", told[0].call.method);
  EXPECT_EQ((RpcValue::Array{"/master", "[/ns/node] Reason: new node registered with same name"}), told[0].call.params);
  EXPECT_EQ((RpcValue::Array{"/master", "/t", RpcValue::Array()}), told[1].call.params);
  EXPECT_EQ((RpcValue::Array{1, "node api", "http://new:3/"}), result("lookupNode", {"/x", NODE}));
}

TEST_F(MasterApiTest, ShutsTheOldProcessDownIfItIsStillThatOne)
{
  result("registerPublisher", {NODE, "/t", "std_msgs/String", API});
  answerPid(7);
  result("registerPublisher", {NODE, "/t", "std_msgs/String", "http://new:3/"});
  ASSERT_EQ(3U, asked.size());
  EXPECT_EQ(API, asked.back().api);
  EXPECT_TRUE(told.empty());
  answerPid(7);
  ASSERT_EQ(1U, told.size());
  EXPECT_EQ(API, told[0].api);
  EXPECT_EQ("shutdown", told[0].call.method);
}

TEST_F(MasterApiTest, SparesAProcessThatHasGotTheAddressOfADeadOne)
{
  result("registerPublisher", {NODE, "/t", "std_msgs/String", API});
  answerPid(7);
  result("registerPublisher", {NODE, "/t", "std_msgs/String", "http://new:3/"});
  answerPid(8);
  EXPECT_TRUE(told.empty());
  result("registerPublisher", {NODE, "/t", "std_msgs/String", API});
  asked.back().done(nullptr);  // which process it is stays unknown
  told.clear();
  result("registerPublisher", {"/other", "/v", "std_msgs/String", API});
  result("registerPublisher", {NODE, "/t", "std_msgs/String", "http://new:4/"});
  EXPECT_TRUE(told.empty()) << told[0].call.method << " " << told[0].api;
}

TEST_F(MasterApiTest, KeepsTypesOfTopics)
{
  result("registerSubscriber", {NODE, "/t", "*", API});
  EXPECT_EQ((RpcValue::Array{1, "current system state", RpcValue::Array()}), result("getTopicTypes", {NODE}));
  result("registerPublisher", {NODE, "/t", "*", API});
  result("registerPublisher", {NODE, "/t", "a/B", API});
  result("registerSubscriber", {NODE, "/t", "c/D", API});
  result("registerSubscriber", {NODE, "/ns/u", "c/D", API});
  EXPECT_EQ((RpcValue::Array{1, "current system state",
                             RpcValue::Array{RpcValue::Array{"/ns/u", "c/D"}, RpcValue::Array{"/t", "a/B"}}}),
            result("getTopicTypes", {NODE}));
  const RpcValue::Array topics{RpcValue(RpcValue::Array{"/t", "a/B"})};
  EXPECT_EQ((RpcValue::Array{1, "current topics", topics}), result("getPublishedTopics", {NODE, ""}));
  EXPECT_EQ((RpcValue::Array{1, "current topics", RpcValue::Array()}), result("getPublishedTopics", {NODE, "/ns"}));
}

TEST_F(MasterApiTest, KnowsServices)
{
  EXPECT_EQ((RpcValue::Array{-1, "no provider", ""}), result("lookupService", {NODE, "/s"}));
  EXPECT_EQ((RpcValue::Array{1, "Registered [/ns/node] as provider of [/ns/node/s]", 1}),
            result("registerService", {NODE, "~s", "rosrpc://a:9", API}));
  EXPECT_EQ((RpcValue::Array{1, "rosrpc URI: [rosrpc://a:9]", "rosrpc://a:9"}),
            result("lookupService", {NODE, "/ns/node/s"}));
  EXPECT_EQ((RpcValue::Array{-1, "unknown node [/other]", ""}), result("lookupNode", {NODE, "/other"}));
  const RpcValue::Array services{RpcValue(RpcValue::Array{"/ns/node/s", RpcValue::Array{NODE}})};
  EXPECT_EQ(
      (RpcValue::Array{1, "current system state", RpcValue::Array{RpcValue::Array(), RpcValue::Array(), services}}),
      result("getSystemState", {NODE}));
  EXPECT_EQ((RpcValue::Array{1, "Unregistered [/ns/node] as provider of [/ns/node/s]", 1}),
            result("unregisterService", {NODE, "~s", "rosrpc://a:9"}));
}

TEST_F(MasterApiTest, ServesParameters)
{
  EXPECT_EQ((RpcValue::Array{1, "parameter /ns/a set", 0}),
            result("setParam", {NODE, "a", RpcValue::Struct{{"b", 1}}}));
  EXPECT_EQ((RpcValue::Array{1, "Parameter [/ns/a/b]", 1}), result("getParam", {NODE, "a/b"}));
  EXPECT_EQ((RpcValue::Array{-1, "Parameter [/ns/c] is not set", 0}), result("getParam", {NODE, "c"}));
  EXPECT_EQ((RpcValue::Array{1, "/ns/a", true}), result("hasParam", {NODE, "a"}));
  EXPECT_EQ((RpcValue::Array{1, "/ns/c", false}), result("hasParam", {NODE, "c"}));
  EXPECT_EQ((RpcValue::Array{1, "Found [/ns/a]", "/ns/a"}), result("searchParam", {NODE, "a"}));
  EXPECT_EQ((RpcValue::Array{-1, "Cannot find parameter [x] in an upwards search", ""}),
            result("searchParam", {NODE, "x"}));
  EXPECT_EQ((RpcValue::Array{0, "Internal failure: invalid key", 0}), result("searchParam", {NODE, "~a"}));
  EXPECT_EQ((RpcValue::Array{1, "Parameter names", RpcValue::Array{RpcValue("/ns/a/b")}}),
            result("getParamNames", {NODE}));
  EXPECT_EQ((RpcValue::Array{1, "parameter /ns/a deleted", 0}), result("deleteParam", {NODE, "a"}));
  EXPECT_EQ((RpcValue::Array{-1, "parameter [/ns/a] is not set", 0}), result("deleteParam", {NODE, "a"}));
  EXPECT_EQ((RpcValue::Array{-1, "Error: invalid arguments: cannot set root of parameter tree to non-dictionary", 0}),
            result("setParam", {NODE, "/", 1}));
}

TEST_F(MasterApiTest, TellsOfParametersUntilANodeWantsNoMore)
{
  EXPECT_EQ((RpcValue::Array{1, "Subscribed to parameter [/p]", RpcValue::Struct()}),
            result("subscribeParam", {NODE, API, "/p"}));
  result("setParam", {NODE, "/p", 1});
  EXPECT_TRUE(told.empty());  // it knows, it has set it
  result("setParam", {"/other", "/p/q", 2});
  ASSERT_EQ(1U, told.size());
  EXPECT_EQ("paramUpdate", told[0].call.method);
  EXPECT_EQ((RpcValue::Array{"/master", "/p/q/", 2}), told[0].call.params);
  const RpcResponse unknown{false, RpcValue::Array{-1, "", 0}};
  told[0].done(nullptr);
  told[0].done(&unknown);
  result("setParam", {"/other", "/p", 3});
  EXPECT_EQ(1U, told.size());
  EXPECT_EQ((RpcValue::Array{1, "Unsubscribe to parameter [/p]", 1}), result("unsubscribeParam", {NODE, API, "/p"}));
}

TEST_F(MasterApiTest, ChecksArgumentsInRosmastersWords)
{
  const std::vector<std::pair<std::pair<std::string, RpcValue::Array>, std::string>> cases{
      {{"getPid", {}}, "missing required caller_id parameter"},
      {{"getPid", {NODE, 1}}, "Error: bad call arity"},
      {{"getPid", {1}}, "caller_id must be a string"},
      {{"getParam", {NODE, ""}}, "ERROR: parameter [key] must be specified and non-empty"},
      {{"getParam", {NODE, 5}}, "ERROR: parameter [key] must be a string"},
      {{"setParam", {NODE, "a", RpcValue()}}, "ERROR: parameter [value] must be specified"},
      {{"registerPublisher", {NODE, "", "a/B", API}}, "ERROR: parameter [topic] must be a non-empty string"},
      {{"registerPublisher", {NODE, "/", "a/B", API}}, "ERROR: parameter [topic] cannot be the global namespace"},
      {{"registerPublisher", {NODE, "http://a", "a/B", API}}, "ERROR: parameter [topic] contains illegal chars"},
      {{"registerPublisher", {NODE, "t", "B", API}},
       "ERROR: parameter [topic_type] is not a valid package resource name"},
      {{"registerPublisher", {NODE, "t", "a/b/C", API}},
       "ERROR: parameter [topic_type] is not a valid package resource name"},
      {{"registerPublisher", {NODE, "t", "a/B", 1}}, "ERROR: parameter [caller_api] is not an XMLRPC URI"},
      {{"registerPublisher", {NODE, "t", "a/B", "a:1"}}, "ERROR: parameter [caller_api] is not an RPC URI"},
      {{"getPublishedTopics", {NODE, 1}}, "ERROR: parameter [subgraph] must be a string"},
  };
  for (const auto& [call, message] : cases)
  {
    const RpcValue::Array answer = result(call.first, call.second);
    EXPECT_EQ(RpcValue(-1), answer[0]) << message;
    EXPECT_EQ(RpcValue(message), answer[1]);
  }
  EXPECT_EQ((RpcValue::Array()), result("registerPublisher", {NODE})[2].as<RpcValue::Array>());
}

TEST_F(MasterApiTest, AnswersUnknownMethodsAndNonsenseWithFaults)
{
  const RpcResponse response = respond("_private", {NODE});
  EXPECT_TRUE(response.is_fault);
  EXPECT_EQ(RpcValue("method \"_private\" is not supported"), response.value.as<RpcValue::Struct>().at("faultString"));
  EXPECT_TRUE(decodeRpcResponse(api.answer("nonsense")).is_fault);
}

TEST_F(MasterApiTest, MakesManyCallsAtATime)
{
  const RpcValue::Struct good{{"methodName", "hasParam"}, {"params", RpcValue::Array{NODE, "/a"}}};
  const RpcValue::Struct unknown{{"methodName", "nothing"}, {"params", RpcValue::Array{NODE}}};
  const RpcValue::Struct again{{"methodName", "system.multicall"}, {"params", RpcValue::Array{RpcValue::Array()}}};
  const RpcResponse response =
      respond("system.multicall", {RpcValue(RpcValue::Array{good, unknown, again, RpcValue(3)})});
  ASSERT_FALSE(response.is_fault);
  const RpcValue::Array& answers = response.value.as<RpcValue::Array>();
  ASSERT_EQ(4U, answers.size());
  EXPECT_EQ(RpcValue(RpcValue::Array{RpcValue(RpcValue::Array{1, "/a", false})}), answers[0]);
  for (size_t index = 1; index < answers.size(); ++index)
  {
    ASSERT_TRUE(answers[index].is<RpcValue::Struct>());
    EXPECT_EQ(RpcValue(1), answers[index].as<RpcValue::Struct>().at("faultCode"));
  }
  EXPECT_TRUE(respond("system.multicall", {1}).is_fault);
}

}  // namespace
}  // namespace pi_os_transport
