#include "ros/client_requests.h"

#include "graph/graph_messages.h"
#include "ros/parameter_json.h"
#include "server/files.h"

#include <ros/console.h>
#include <ros/time.h>

#include <boost/asio/post.hpp>
#include <stdexcept>
#include <type_traits>
#include <utility>

namespace pi_web
{
namespace
{

using nlohmann::json;

constexpr int MAX_WAITING = 8;  // of a client, for services and parameters

}  // namespace

ClientRequests::ClientRequests(const Parts& parts)
  : parts_(parts), session_(std::to_string(ros::WallTime::now().toNSec())), parameter_thread_("web_params")
{
  parameter_thread_.start();
}

void ClientRequests::stop()
{
  parameter_thread_.stop();
}

void ClientRequests::onOpen(Client* client)
{
  clients_[client].number = ++last_client_;
  json capabilities = {"parameters", "connectionGraph", "assets"};
  if (ros::Time::isSimTime())
  {
    capabilities.push_back("time");
  }
  if (client->mayControl())
  {
    capabilities.push_back("clientPublish");
    capabilities.push_back("services");
  }
  client->answer(textMessage({{"op", "serverInfo"},
                              {"name", "π-Edge"},
                              {"capabilities", capabilities},
                              {"supportedEncodings", {"ros1"}},
                              {"metadata", {{"ROS_DISTRO", "noetic"}}},
                              {"sessionId", session_}}));
  client->answer(textMessage({{"op", "advertise"}, {"channels", parts_.channels->describe(parts_.channels->ids())}}));
  if (client->mayControl())
  {
    client->answer(textMessage(parts_.services->advertisement()));
  }
  if (clients_.size() == 1)
  {
    parts_.on_any(true);
  }
}

void ClientRequests::onClose(Client* client)
{
  parts_.channels->remove(client);
  parts_.publishers->remove(client);
  clients_.erase(client);
  if (clients_.empty())
  {
    parts_.on_any(false);
  }
}

void ClientRequests::workFor(Client* client, pi_node::CallbackThread* thread, std::function<OutMessage()> work)
{
  State& state = clients_.at(client);
  if (state.waiting >= MAX_WAITING)
  {
    throw std::invalid_argument(std::to_string(MAX_WAITING) + " requests of this client wait for their answer");
  }
  ++state.waiting;
  thread->post(
      [this, client, number = state.number, work = std::move(work)]
      {
        OutMessage answer;
        try
        {
          answer = work();
        }
        catch (const std::exception& error)
        {
          answer = statusMessage(StatusLevel::ERROR, error.what());
        }
        boost::asio::post(*parts_.context,
                          [this, client, number, answer = std::move(answer)]
                          {
                            const auto known = clients_.find(client);
                            if (known != clients_.end() && known->second.number == number)
                            {
                              --known->second.waiting;
                              client->answer(answer);
                            }
                          });
      });
}

template <typename Asked>
void ClientRequests::handle(Client* client, const Asked& asked)
{
  if constexpr (std::is_same_v<Asked, request::Subscribe>)
  {
    std::string wrong;
    for (const auto& [subscription, channel] : asked.subscriptions)
    {
      try
      {
        parts_.channels->subscribe(client, subscription, channel);
      }
      catch (const std::invalid_argument& error)
      {
        wrong += (wrong.empty() ? "" : "; ") + std::string(error.what());  // the others are served
      }
    }
    if (!wrong.empty())
    {
      throw std::invalid_argument(wrong);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::Unsubscribe>)
  {
    for (const uint32_t subscription : asked.subscriptions)
    {
      parts_.channels->unsubscribe(client, subscription);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::GetParameters>)
  {
    workFor(client, &parameter_thread_, [this, asked] { return answerTo(asked, *parts_.reader); });
  }
  else if constexpr (std::is_same_v<Asked, request::WatchGraph>)
  {
    clients_.at(client).watches_graph = asked.on;
    if (const json all = graphUpdate(GraphState(), graph_); asked.on && !all.is_null())
    {
      client->answer(textMessage(all));
    }
  }
  else if constexpr (std::is_same_v<Asked, request::FetchAsset>)
  {
    try
    {
      const std::string content = assetOf(asked.uri);
      client->answer(assetResponse(asked.id, "", std::make_shared<Bytes>(content.begin(), content.end())));
    }
    catch (const std::invalid_argument& error)
    {
      client->answer(assetResponse(asked.id, error.what(), nullptr));
    }
  }
  else
  {
    if (!client->mayControl())
    {
      throw std::invalid_argument("this connection may only watch; it needs the token and allow_control");
    }
    control(client, asked);
  }
}

template <typename Asked>
void ClientRequests::control(Client* client, const Asked& asked)
{
  if constexpr (std::is_same_v<Asked, request::Advertise>)
  {
    for (const request::ClientChannel& channel : asked.channels)
    {
      parts_.publishers->advertise(client, channel, types_);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::Unadvertise>)
  {
    for (const uint32_t channel : asked.channels)
    {
      parts_.publishers->unadvertise(client, channel);
    }
  }
  else if constexpr (std::is_same_v<Asked, request::Publish>)
  {
    parts_.publishers->publish(client, asked);
  }
  else if constexpr (std::is_same_v<Asked, request::SetParameters>)
  {
    workFor(client, &parameter_thread_, [this, asked] { return answerTo(asked, *parts_.reader); });
  }
  else
  {
    static_assert(std::is_same_v<Asked, request::CallService>);
    const Services::Service& service = parts_.services->at(asked.service);
    if (asked.encoding != "ros1")
    {
      throw std::invalid_argument("encoding of a call must be ros1");
    }
    ROS_INFO_STREAM_NAMED("web_view", client->name() << " calls " << service.name);
    workFor(client, service.thread,
            [this, name = service.name, id = asked.service, call = asked.call, bytes = std::string(asked.payload)]
            {
              try
              {
                return serviceResponse(id, call, "ros1", parts_.reader->call(name, bytes, parts_.call_limit_s));
              }
              catch (const std::exception& error)
              {
                return serviceFailure(id, call, error.what());
              }
            });
  }
}

void ClientRequests::onRequest(Client* client, const Request& request)
{
  std::visit([&](const auto& one) { handle(client, one); }, request);
}

void ClientRequests::broadcast(const json& object, bool only_control)
{
  for (const auto& [client, state] : clients_)
  {
    if (client->mayControl() || !only_control)
    {
      client->answer(textMessage(object));
    }
  }
}

void ClientRequests::sendTime()
{
  constexpr uint32_t no_subscription = ~0U;
  for (const auto& [client, state] : clients_)
  {
    client->push(no_subscription, timeMessage(ros::Time::now().toNSec()), 1);
  }
}

void ClientRequests::onGraph(const GraphState& graph, const std::map<std::string, MessageType>& types)
{
  types_ = types;
  if (const json update = graphUpdate(graph_, graph); !update.is_null())
  {
    for (const auto& [client, state] : clients_)
    {
      if (state.watches_graph)
      {
        client->answer(textMessage(update));
      }
    }
  }
  graph_ = graph;
}

uint64_t ClientRequests::dropped() const
{
  uint64_t dropped = 0;
  for (const auto& [client, state] : clients_)
  {
    dropped += client->dropped();
  }
  return dropped;
}

}  // namespace pi_web
