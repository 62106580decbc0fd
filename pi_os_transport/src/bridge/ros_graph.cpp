#include "bridge/ros_graph.h"

#include <cstdlib>
#include <set>
#include <stdexcept>
#include <vector>

#include "event_loop/if_alive.h"
#include "master/network_address.h"
#include "master/rpc_encoder.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

constexpr char CALLER[] = "/pi_os_bridge";
constexpr char DEFAULT_MASTER[] = "http://localhost:11311";
constexpr std::chrono::seconds SERVED_FOR{2};
constexpr size_t MOST_SERVED = 1000;
constexpr size_t MOST_PROBES = 64;
constexpr size_t MOST_DEVICES = 64;  ///< asked for at the same time
/// Strangers who knock all the time cost the master this much at most.
constexpr std::chrono::milliseconds SEARCH_INTERVAL{300};

NodeCallerLimits limits()
{
  NodeCallerLimits limits;
  limits.connect = std::chrono::milliseconds(500);
  limits.reply = std::chrono::milliseconds(1000);
  return limits;
}

std::string masterOf(const std::string& configured)
{
  const char* const variable = std::getenv("ROS_MASTER_URI");
  return !configured.empty() ? configured : variable != nullptr ? variable : DEFAULT_MASTER;
}

/// "scheme://host:port/" of a service or a node. Nothing if the text is none.
std::optional<HostAndPort> placeOf(const RpcValue* uri)
{
  if (uri == nullptr || !uri->is<std::string>())
  {
    return std::nullopt;
  }
  const std::string& text = uri->as<std::string>();
  const size_t scheme = text.find("://");
  try
  {
    return scheme == std::string::npos ? std::nullopt : std::make_optional(parseHttpUri("http" + text.substr(scheme)));
  }
  catch (const std::invalid_argument&)
  {
    return std::nullopt;
  }
}

std::string addressOf(const SocketAddress& address)
{
  return address.size != 0 && address.storage.ss_family == AF_INET
             ? addressText(reinterpret_cast<const sockaddr_in&>(address.storage))
             : std::string();
}

/// The names in the answer to getSystemState: [publishers, subscribers, services], each [[subject, [node, ...]], ...].
std::set<std::string> nodesOf(const RpcValue& state)
{
  std::set<std::string> nodes;
  const auto itemsOf = [](const RpcValue& value)
  { return value.array() != nullptr ? *value.array() : RpcValue::Array(); };
  for (const RpcValue& kind : itemsOf(state))
  {
    for (const RpcValue& subject : itemsOf(kind))
    {
      const RpcValue::Array pair = itemsOf(subject);
      for (const RpcValue& node : pair.size() == 2 ? itemsOf(pair[1]) : RpcValue::Array())
      {
        if (node.is<std::string>() && isGraphName(node.as<std::string>()))
        {
          nodes.insert(node.as<std::string>());
        }
      }
    }
  }
  return nodes;
}

}  // namespace

/// Looks up all nodes, one after the other.
struct RosGraph::Search
{
  std::vector<std::string> nodes;
};

RosGraph::RosGraph(EventLoop* loop, const std::string& master)
  : loop_(loop), master_(masterOf(master)), caller_(loop, limits()), resolver_(loop)
{
}

/// @param argument  "": none. `done` gets the value of a positive answer, else null.
void RosGraph::ask(const std::string& method, const std::string& argument,
                   std::function<void(const RpcValue* value)> done)
{
  RpcValue::Array params{CALLER};
  if (!argument.empty())
  {
    params.emplace_back(argument);
  }
  NodeCall call;
  call.body = std::make_shared<const std::string>(encodeRpcCall(method, params));
  call.done = [done = std::move(done)](const RpcResponse* response)
  {
    const RpcValue::Array* const answer =
        response != nullptr && !response->is_fault ? response->value.array() : nullptr;
    const bool is_yes = answer != nullptr && answer->size() == 3 && (*answer)[0] == RpcValue(int32_t{1});
    done(is_yes ? &(*answer)[2] : nullptr);
  };
  caller_.call(master_, std::move(call));
}

void RosGraph::findService(const std::string& service, const Endpoint& at, Answer answer)
{
  if (!isGraphName(service))
  {
    answer(service.empty() ? "the other bridge names no service: it is of an older build"
                           : "the name of the service is not valid");
    return;
  }
  const auto known = served_.find(service + " " + at.toString());
  if (known != served_.end() && known->second > SteadyClock::now())
  {
    answer("");
    return;
  }
  ask("lookupService", service,
      [this, service, at, answer = std::move(answer)](const RpcValue* uri)
      { onRegistration(service, at, uri, answer); });
}

void RosGraph::onRegistration(const std::string& service, const Endpoint& at, const RpcValue* uri, const Answer& answer)
{
  const std::optional<HostAndPort> place = placeOf(uri);
  if (!place || place->port != at.port)
  {
    answer((place ? service + " is registered at another port" : service + " is not registered") +
           " with the ROS master at " + master_);
    return;
  }
  resolver_.resolve(place->host, place->port,
                    [this, service, at, answer, host = place->host](const SocketAddress& resolved)
                    {
                      // The name of this device is often that of a loopback address in its own /etc/hosts.
                      const std::string address = addressOf(resolved);
                      if (isLocalAddress(address))
                      {
                        probe(service, at, answer);
                        return;
                      }
                      answer(service + " is registered at " + host + ", which is not this device");
                    });
}

void RosGraph::probe(const std::string& service, const Endpoint& at, const Answer& answer)
{
  if (probes_.size() >= MOST_PROBES)
  {
    answer("too many services are being opened");
    return;
  }
  const auto key = std::make_shared<ServiceProbe*>(nullptr);
  const auto probe = std::make_shared<ServiceProbe>(
      loop_, service,
      [this, service, at, answer, key](bool served)
      {
        const std::shared_ptr<ServiceProbe> ended = probes_[*key];
        probes_.erase(*key);
        if (served_.size() > MOST_SERVED)
        {
          served_.clear();
        }
        if (served)
        {
          served_[service + " " + at.toString()] = SteadyClock::now() + SERVED_FOR;
        }
        answer(served ? "" : "nobody serves " + service + " at " + at.toString() + " any more");
      });
  *key = probe.get();
  probes_[probe.get()] = probe;
  probe->start(at);
}

void RosGraph::findDevice(const std::string& address, Answer answer)
{
  if (wanted_.size() + sought_.size() >= MOST_DEVICES)
  {
    answer("too many unknown devices knock");
    return;
  }
  wanted_.emplace(address, std::move(answer));
  if (!search_ && !search_timer_.running())
  {
    search_timer_.start(loop_, next_search_, [this] { startSearch(); });
  }
}

void RosGraph::startSearch()
{
  next_search_ = SteadyClock::now() + SEARCH_INTERVAL;
  sought_.swap(wanted_);
  search_ = std::make_shared<Search>();
  ask("getSystemState", "",
      [this, search = search_](const RpcValue* state)
      {
        if (state == nullptr)
        {
          endSearch("the ROS master at " + master_ + " does not answer");
          return;
        }
        const std::set<std::string> nodes = nodesOf(*state);
        search->nodes.assign(nodes.begin(), nodes.end());
        lookUpNext(search);
      });
}

void RosGraph::lookUpNext(const std::shared_ptr<Search>& search)
{
  if (search->nodes.empty() || sought_.empty())
  {
    endSearch("no node of it is registered with the ROS master at " + master_);
    return;
  }
  const std::string node = search->nodes.back();
  search->nodes.pop_back();
  ask("lookupNode", node,
      [this, search](const RpcValue* uri)
      {
        const std::optional<HostAndPort> place = placeOf(uri);
        if (!place)
        {
          lookUpNext(search);
          return;
        }
        resolver_.resolve(place->host, place->port,
                          [this, search](const SocketAddress& address)
                          {
                            onHost(addressOf(address));
                            lookUpNext(search);
                          });
      });
}

void RosGraph::onHost(const std::string& address)
{
  for (auto found = sought_.find(address); found != sought_.end(); found = sought_.find(address))
  {
    const Answer answer = std::move(found->second);
    sought_.erase(found);
    answer("");
  }
}

void RosGraph::endSearch(const std::string& refusal)
{
  search_.reset();
  const std::multimap<std::string, Answer> unknown = std::exchange(sought_, {});
  for (const auto& one : unknown)
  {
    one.second(refusal);
  }
  if (!wanted_.empty() && !search_timer_.running())
  {
    search_timer_.start(loop_, next_search_, [this] { startSearch(); });
  }
}

}  // namespace pi_os_transport
