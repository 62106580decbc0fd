#include "rosout/rosout_node.h"

#include <unistd.h>

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include "rosout/log_message.h"

namespace pi_os_transport
{

const std::string RosoutNode::NAME = "/rosout";
const std::string RosoutNode::SUBSCRIBED = "/rosout";
const std::string RosoutNode::PUBLISHED = "/rosout_agg";

RosoutNode::RosoutNode(EventLoop* loop, Environment environment)
  : environment_(std::move(environment))
  , publisher_(loop, environment_.network.bind, NAME, PUBLISHED)
  , subscriber_(loop, environment_.calls, NAME, SUBSCRIBED, [this](std::string_view message) { onMessage(message); })
  , server_(loop, environment_.network.bind, 0, [this](std::string_view request) { return methods_.answer(request); })
{
  addMethods();
}

std::string RosoutNode::uri() const
{
  return httpUri(environment_.network.host, server_.port());
}

void RosoutNode::onMessage(std::string_view message)
{
  publisher_.publish(message);
  if (environment_.file == nullptr)
  {
    return;
  }
  if (const std::optional<LogMessage> read = readLogMessage(message))
  {
    environment_.file->write(formatLogMessage(*read, !environment_.omits_topics()));
  }
}

void RosoutNode::setPublishers(const RpcValue& apis)
{
  std::set<std::string> publishers;
  for (const RpcValue& api : apis.array() != nullptr ? *apis.array() : RpcValue::Array())
  {
    if (api.is<std::string>())
    {
      publishers.insert(api.as<std::string>());
    }
  }
  subscriber_.setPublishers(publishers);
}

void RosoutNode::addMethods()
{
  methods_.add("getBusStats", RpcValue::Array(), {},
               [this](const std::string&, RpcValue::Array&)
               {
                 return rpcResult(
                     1, "",
                     RpcValue::Array{RpcValue(RpcValue::Array{publisher_.busStats()}),
                                     RpcValue(RpcValue::Array{subscriber_.busStats()}), RpcValue::Array()});
               });
  methods_.add("getBusInfo", RpcValue::Array(), {},
               [this](const std::string&, RpcValue::Array&)
               {
                 RpcValue::Array info = publisher_.busInfo();
                 for (RpcValue& link : subscriber_.busInfo())
                 {
                   info.push_back(std::move(link));
                 }
                 return rpcResult(1, "", std::move(info));
               });
  methods_.add("getMasterUri", "", {},
               [this](const std::string&, RpcValue::Array&) { return rpcResult(1, "", environment_.master_uri); });
  methods_.add("getPid", -1, {}, [](const std::string&, RpcValue::Array&) { return rpcResult(1, "", getpid()); });
  // roscore would restart the node at once, so it only drops its connections.
  methods_.add("shutdown", 0, {check::any()},
               [this](const std::string&, RpcValue::Array&)
               {
                 publisher_.disconnectAll();
                 return rpcResult(1, "shutdown", 0);
               });
  const auto topic = [](const std::string& name) {
    return RpcValue(RpcValue::Array{RpcValue(RpcValue::Array{name, LogType::name()})});
  };
  methods_.add("getSubscriptions", RpcValue::Array(), {},
               [topic](const std::string&, RpcValue::Array&)
               { return rpcResult(1, "subscriptions", topic(SUBSCRIBED)); });
  methods_.add("getPublications", RpcValue::Array(), {},
               [topic](const std::string&, RpcValue::Array&)
               { return rpcResult(1, "publications", topic(PUBLISHED)); });
  methods_.add("paramUpdate", 0, {check::text("key"), check::any()},
               [](const std::string&, RpcValue::Array&) { return rpcResult(-1, "no parameter is subscribed to", 0); });
  methods_.add("publisherUpdate", 0, {check::graphName("topic"), check::any()},
               [this](const std::string&, RpcValue::Array& arguments)
               {
                 if (arguments[0] != RpcValue(SUBSCRIBED))
                 {
                   return rpcResult(-1, "not subscribed to " + arguments[0].as<std::string>(), 0);
                 }
                 setPublishers(arguments[1]);
                 return rpcResult(1, "", 0);
               });
  methods_.add("requestTopic", RpcValue::Array(), {check::graphName("topic"), check::any()},
               [this](const std::string&, RpcValue::Array& arguments)
               { return answerTopicRequest(arguments[0], arguments[1]); });
}

RpcValue RosoutNode::answerTopicRequest(const RpcValue& topic, const RpcValue& protocols) const
{
  if (topic != RpcValue(PUBLISHED))
  {
    return rpcResult(0, "no publisher of " + topic.as<std::string>(), 0);
  }
  const auto isTcpros = [](const RpcValue& protocol)
  {
    return protocol.array() != nullptr && !protocol.array()->empty() && protocol.array()->front() == RpcValue("TCPROS");
  };
  if (protocols.array() == nullptr || std::none_of(protocols.array()->begin(), protocols.array()->end(), isTcpros))
  {
    return rpcResult(0, "no supported protocol: TCPROS is spoken here", 0);
  }
  const std::string& host = environment_.network.host;
  return rpcResult(1, "ready on " + host, RpcValue::Array{"TCPROS", host, static_cast<int32_t>(publisher_.port())});
}

}  // namespace pi_os_transport
