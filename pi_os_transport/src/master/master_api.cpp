#include "master/master_api.h"

#include <unistd.h>

#include <memory>
#include <optional>
#include <utility>

#include "master/graph_name.h"
#include "master/rpc_encoder.h"

namespace pi_os_transport
{
namespace
{

const std::string MASTER = "/master";  // caller's name in calls of nodes
const std::string ANY_TYPE = "*";

const char* nameOf(Role role)
{
  static constexpr const char* NAMES[] = {"SUB", "PUB", "SERVICE", "CACHEDPARAM"};
  return NAMES[static_cast<size_t>(role)];
}

const std::string& text(const RpcValue::Array& arguments, size_t index)
{
  return arguments[index].as<std::string>();
}

std::shared_ptr<const std::string> body(std::string_view method, RpcValue::Array params)
{
  params.insert(params.begin(), MASTER);
  return std::make_shared<const std::string>(encodeRpcCall(method, params));
}

/// The list in an answer of a node; null if there is none.
const RpcValue::Array* valuesOf(const RpcResponse* response)
{
  return response != nullptr && !response->is_fault ? response->value.array() : nullptr;
}

/// The process id in an answer to getPid; 0 if there is none.
int pidOf(const RpcResponse* response)
{
  const RpcValue::Array* const values = valuesOf(response);
  return values != nullptr && values->size() == 3 && values->back().is<int>() ? values->back().as<int>() : 0;
}

}  // namespace

MasterApi::MasterApi(std::string uri, NodeCalls* calls, std::function<void(const std::string& reason)> shut_down,
                     Log log)
  : uri_(std::move(uri)), calls_(calls), log_(std::move(log))
{
  addNodeMethods(std::move(shut_down));
  addParameterMethods();
  addParameterSubscriptionMethods();
  addRegistrationMethods();
  addStateMethods();
}

void MasterApi::enrol(Role role, const std::string& key, const std::string& node, const std::string& api,
                      const std::string& service_api)
{
  logChange("+", role, key, node, api);
  const bool is_new = registrations_.nodeApi(node) == nullptr;
  const std::optional<Registrations::Replaced> replaced = registrations_.add(role, key, node, api, service_api);
  if (is_new || replaced)
  {
    calls_->call(api, {body("getPid", {}), "", [this, node, api](const RpcResponse* response) {
                         registrations_.setPid(node, api, pidOf(response));
                       }});
  }
  if (replaced)
  {
    shutDown(node, *replaced);
    for (const std::string& topic : replaced->topics)
    {
      tellSubscribers(topic);
    }
  }
}

/// Shuts down the old process of a node. Checks the process id first: another node may use the port of a dead one.
void MasterApi::shutDown(const std::string& node, const Registrations::Replaced& old)
{
  const auto call = body("shutdown", {"[" + node + "] Reason: new node registered with same name"});
  if (old.pid != 0)
  {
    calls_->call(old.api, {body("getPid", {}), "",
                           [this, api = old.api, pid = old.pid, call](const RpcResponse* response)
                           {
                             if (pidOf(response) == pid)
                             {
                               calls_->call(api, {call, "", nullptr});
                             }
                           }});
  }
  else if (!registrations_.isInUse(old.api))
  {
    calls_->call(old.api, {call, "", nullptr});
  }
}

void MasterApi::logChange(const char* sign, Role role, const std::string& key, const std::string& node,
                          const std::string& api) const
{
  if (log_)
  {
    log_(std::string(sign) + nameOf(role) + " [" + key + "] " + node + " " + api);
  }
}

void MasterApi::tellSubscribers(const std::string& topic)
{
  const std::vector<Registrations::Provider>& subscribers = registrations_.providers(Role::SUBSCRIBER, topic);
  if (subscribers.empty())
  {
    return;
  }
  const auto call = body("publisherUpdate", {topic, registrations_.apis(Role::PUBLISHER, topic)});
  for (const Registrations::Provider& subscriber : subscribers)
  {
    calls_->call(subscriber.api, {call, "topic " + topic, nullptr});
  }
}

void MasterApi::tellOfParameter(const std::string& key, const RpcValue& value, const std::string* changed_by)
{
  const std::vector<std::string> subscriptions = registrations_.keys(Role::PARAMETER_SUBSCRIBER);
  for (const ParameterUpdate& update : parameterUpdates(subscriptions, key, value))
  {
    const auto call = body("paramUpdate", {update.key, *update.value});
    for (const auto& [node, api] : registrations_.providers(Role::PARAMETER_SUBSCRIBER, update.subscription))
    {
      if (update.by_others && changed_by != nullptr && node == *changed_by)
      {
        continue;
      }
      // A node that does not know the parameter any more answers -1: remove its subscription.
      const auto done = [this, node = node, api = api, subscription = update.subscription](const RpcResponse* response)
      {
        const RpcValue::Array* const values = valuesOf(response);
        if (values != nullptr && !values->empty() && values->front() == RpcValue(-1))
        {
          registrations_.remove(Role::PARAMETER_SUBSCRIBER, subscription, node, api);
        }
      };
      calls_->call(api, {call, "parameter " + update.key, done});
    }
  }
}

void MasterApi::setParameter(const std::string& key, RpcValue value, const std::string& caller)
{
  // From the copy in the tree, because subscribers of its parts get pointers into it.
  switch (parameters_.set(key, std::move(value)))
  {
    case ParameterTree::SetResult::DONE:
      tellOfParameter(key, *parameters_.get(key), &caller);
      break;
    case ParameterTree::SetResult::ROOT_IS_NO_STRUCT:
      throw RpcArgumentError("Error: invalid arguments: cannot set root of parameter tree to non-dictionary");
    case ParameterTree::SetResult::TOO_DEEP:
      throw RpcArgumentError("ERROR: parameter [key] has more than " + std::to_string(ParameterTree::MAX_DEPTH) +
                             " namespaces");
  }
}

RpcValue::Array MasterApi::addSubscriber(const std::string& node, const std::string& topic, const std::string& type,
                                         const std::string& api)
{
  enrol(Role::SUBSCRIBER, topic, node, api);
  if (type != ANY_TYPE)
  {
    topic_types_.emplace(topic, type);  // keeps the type of a publisher
  }
  return registrations_.apis(Role::PUBLISHER, topic);
}

RpcValue::Array MasterApi::addPublisher(const std::string& node, const std::string& topic, const std::string& type,
                                        const std::string& api)
{
  enrol(Role::PUBLISHER, topic, node, api);
  if (type != ANY_TYPE || topic_types_.count(topic) == 0)
  {
    topic_types_[topic] = type;
  }
  tellSubscribers(topic);
  return registrations_.apis(Role::SUBSCRIBER, topic);
}

void MasterApi::addNodeMethods(std::function<void(const std::string& reason)> shut_down)
{
  methods_.add("shutdown", 0, {check::any()},
               [shut_down = std::move(shut_down)](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string why = arguments[0].is<std::string>() ? text(arguments, 0) : "";
                 shut_down("external shutdown request from [" + caller + "]: " + why);
                 return rpcResult(1, "shutdown", 0);
               });
  methods_.add("getUri", "", {}, [this](const std::string&, RpcValue::Array&) { return rpcResult(1, "", uri_); });
  methods_.add("getPid", -1, {}, [](const std::string&, RpcValue::Array&) { return rpcResult(1, "", getpid()); });
}

void MasterApi::addParameterMethods()
{
  methods_.add("deleteParam", 0, {check::text("key")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string key = resolveName(text(arguments, 0), caller);
                 if (!parameters_.remove(key))
                 {
                   return rpcResult(-1, "parameter [" + key + "] is not set", 0);
                 }
                 tellOfParameter(key, RpcValue::Struct(), nullptr);
                 return rpcResult(1, "parameter " + key + " deleted", 0);
               });
  methods_.add("setParam", 0, {check::text("key"), check::notNil("value")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string key = resolveName(text(arguments, 0), caller);
                 setParameter(key, std::move(arguments[1]), caller);
                 return rpcResult(1, "parameter " + key + " set", 0);
               });
  methods_.add("getParam", 0, {check::text("key")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string key = resolveName(text(arguments, 0), caller);
                 const RpcValue* value = parameters_.get(key);
                 return value != nullptr ? rpcResult(1, "Parameter [" + key + "]", *value)
                                         : rpcResult(-1, "Parameter [" + key + "] is not set", 0);
               });
  methods_.add("searchParam", 0, {check::text("key")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string& key = text(arguments, 0);
                 if (key[0] == '~')
                 {
                   return rpcResult(0, "Internal failure: invalid key", 0);
                 }
                 if (caller.empty() || caller[0] != '/')
                 {
                   return rpcResult(0, "Internal failure: namespace must be global", 0);
                 }
                 const std::optional<std::string> found = parameters_.search(caller, key);
                 return found ? rpcResult(1, "Found [" + *found + "]", *found)
                              : rpcResult(-1, "Cannot find parameter [" + key + "] in an upwards search", "");
               });
  methods_.add("hasParam", false, {check::text("key")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string key = resolveName(text(arguments, 0), caller);
                 return rpcResult(1, key, parameters_.get(key) != nullptr);
               });
  methods_.add("getParamNames", RpcValue::Array(), {},
               [this](const std::string&, RpcValue::Array&)
               { return rpcResult(1, "Parameter names", parameters_.names()); });
}

void MasterApi::addParameterSubscriptionMethods()
{
  methods_.add("subscribeParam", 0, {check::api("caller_api"), check::text("key")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string key = resolveName(text(arguments, 1), caller);
                 enrol(Role::PARAMETER_SUBSCRIBER, parameterSubscriptionKey(key), caller, text(arguments, 0));
                 const RpcValue* value = parameters_.get(key);
                 return rpcResult(1, "Subscribed to parameter [" + key + "]",
                                  value != nullptr ? *value : RpcValue::Struct());
               });
  methods_.add("unsubscribeParam", 0, {check::api("caller_api"), check::text("key")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string key = resolveName(text(arguments, 1), caller);
                 logChange("-", Role::PARAMETER_SUBSCRIBER, key, caller, text(arguments, 0));
                 registrations_.remove(Role::PARAMETER_SUBSCRIBER, parameterSubscriptionKey(key), caller,
                                       text(arguments, 0));
                 return rpcResult(1, "Unsubscribe to parameter [" + key + "]", 1);
               });
}

void MasterApi::addRegistrationMethods()
{
  methods_.add("registerService", 0, {check::graphName("service"), check::api("service_api"), check::api("caller_api")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 enrol(Role::SERVICE, text(arguments, 0), caller, text(arguments, 2), text(arguments, 1));
                 return rpcResult(1, "Registered [" + caller + "] as provider of [" + text(arguments, 0) + "]", 1);
               });
  methods_.add("registerSubscriber", RpcValue::Array(),
               {check::graphName("topic"), check::typeName("topic_type"), check::api("caller_api")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string& topic = text(arguments, 0);
                 return rpcResult(1, "Subscribed to [" + topic + "]",
                                  addSubscriber(caller, topic, text(arguments, 1), text(arguments, 2)));
               });
  methods_.add("registerPublisher", RpcValue::Array(),
               {check::graphName("topic"), check::typeName("topic_type"), check::api("caller_api")},
               [this](const std::string& caller, RpcValue::Array& arguments)
               {
                 const std::string& topic = text(arguments, 0);
                 return rpcResult(1, "Registered [" + caller + "] as publisher of [" + topic + "]",
                                  addPublisher(caller, topic, text(arguments, 1), text(arguments, 2)));
               });
  const auto unregister = [this](Role role)
  {
    return [this, role](const std::string& caller, RpcValue::Array& arguments)
    {
      logChange("-", role, text(arguments, 0), caller, text(arguments, 1));
      const Registrations::Removal removal =
          registrations_.remove(role, text(arguments, 0), caller, text(arguments, 1));
      if (role == Role::PUBLISHER && removal.count != 0)
      {
        tellSubscribers(text(arguments, 0));
      }
      return rpcResult(1, removal.message, removal.count);
    };
  };
  methods_.add("unregisterService", 0, {check::graphName("service"), check::api("service_api")},
               unregister(Role::SERVICE));
  methods_.add("unregisterSubscriber", 0, {check::graphName("topic"), check::api("caller_api")},
               unregister(Role::SUBSCRIBER));
  methods_.add("unregisterPublisher", 0, {check::graphName("topic"), check::api("caller_api")},
               unregister(Role::PUBLISHER));
}

void MasterApi::addStateMethods()
{
  methods_.add("lookupService", "", {check::graphName("service")},
               [this](const std::string&, RpcValue::Array& arguments)
               {
                 const std::string* api = registrations_.serviceApi(text(arguments, 0));
                 return api != nullptr ? rpcResult(1, "rosrpc URI: [" + *api + "]", *api)
                                       : rpcResult(-1, "no provider", "");
               });
  methods_.add("lookupNode", "", {check::graphName("node", true)},
               [this](const std::string&, RpcValue::Array& arguments)
               {
                 const std::string* api = registrations_.nodeApi(text(arguments, 0));
                 return api != nullptr ? rpcResult(1, "node api", *api)
                                       : rpcResult(-1, "unknown node [" + text(arguments, 0) + "]", "");
               });
  methods_.add("getPublishedTopics", 0, {check::graphNameOrEmpty("subgraph")},
               [this](const std::string&, RpcValue::Array& arguments)
               {
                 std::string space = text(arguments, 0);
                 if (!space.empty() && space.back() != '/')
                 {
                   space += '/';
                 }
                 RpcValue::Array topics;
                 for (const std::string& topic : registrations_.keys(Role::PUBLISHER))
                 {
                   if (topic.compare(0, space.size(), space) == 0)
                   {
                     topics.emplace_back(RpcValue::Array{topic, topic_types_[topic]});
                   }
                 }
                 return rpcResult(1, "current topics", std::move(topics));
               });
  methods_.add("getTopicTypes", RpcValue::Array(), {},
               [this](const std::string&, RpcValue::Array&)
               {
                 RpcValue::Array types;
                 for (const auto& [topic, type] : topic_types_)
                 {
                   types.emplace_back(RpcValue::Array{topic, type});
                 }
                 return rpcResult(1, "current system state", std::move(types));
               });
  methods_.add("getSystemState", RpcValue::Array{RpcValue::Array(), RpcValue::Array(), RpcValue::Array()}, {},
               [this](const std::string&, RpcValue::Array&)
               {
                 return rpcResult(
                     1, "current system state",
                     RpcValue::Array{registrations_.state(Role::PUBLISHER), registrations_.state(Role::SUBSCRIBER),
                                     registrations_.state(Role::SERVICE)});
               });
}

}  // namespace pi_os_transport
