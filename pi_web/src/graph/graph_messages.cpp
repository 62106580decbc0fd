#include "graph/graph_messages.h"

#include <algorithm>

namespace pi_web
{
namespace
{

using nlohmann::json;
using Nodes = std::map<std::string, std::set<std::string>>;

json changed(const Nodes& before, const Nodes& now, const char* ids)
{
  json list = json::array();
  for (const auto& [name, nodes] : now)
  {
    const auto old = before.find(name);
    if (old == before.end() || old->second != nodes)
    {
      list.push_back({{"name", name}, {ids, nodes}});
    }
  }
  return list;
}

json removedNames(const Nodes& before, const Nodes& before_too, const Nodes& now, const Nodes& now_too)
{
  std::set<std::string> names;
  for (const Nodes* nodes : {&before, &before_too})
  {
    for (const auto& entry : *nodes)
    {
      if (now.count(entry.first) == 0 && now_too.count(entry.first) == 0)
      {
        names.insert(entry.first);
      }
    }
  }
  return names;
}

}  // namespace

json graphUpdate(const GraphState& before, const GraphState& now)
{
  json update = {
      {"op", "connectionGraphUpdate"},
      {"publishedTopics", changed(before.publishers, now.publishers, "publisherIds")},
      {"subscribedTopics", changed(before.subscribers, now.subscribers, "subscriberIds")},
      {"advertisedServices", changed(before.providers, now.providers, "providerIds")},
      {"removedTopics", removedNames(before.publishers, before.subscribers, now.publishers, now.subscribers)},
      {"removedServices", removedNames(before.providers, {}, now.providers, {})}};
  for (const auto& [key, value] : update.items())
  {
    if (value.is_array() && !value.empty())
    {
      return update;
    }
  }
  return nullptr;
}

std::string linksJson(const std::map<std::string, Links>& links)
{
  json list = json::array();
  for (const auto& [transport, one] : links)
  {
    list.push_back({{"transport", transport}, {"links", one.count}, {"topics", one.topics}});
  }
  std::sort(list.begin(), list.end(), [](const json& a, const json& b) { return a["links"] > b["links"]; });
  return list.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace pi_web
