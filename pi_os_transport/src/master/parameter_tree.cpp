#include "master/parameter_tree.h"

#include <map>
#include <string_view>
#include <utility>

#include "master/graph_name.h"

namespace pi_os_transport
{
namespace
{

void appendNames(RpcValue::Array* names, const std::string& space, const RpcValue::Struct& members)
{
  for (const auto& [name, value] : members)
  {
    if (value.is<RpcValue::Struct>())
    {
      appendNames(names, joinName(space, name), value.as<RpcValue::Struct>());
    }
    else
    {
      names->emplace_back(joinName(space, name));
    }
  }
}

using Found = std::vector<std::pair<std::string, const RpcValue*>>;

/// Appends all keys below `key`, which ends in a slash, parents first.
void appendKeys(Found* found, const std::string& key, const RpcValue::Struct& members)
{
  for (const auto& [name, value] : members)
  {
    found->emplace_back(joinName(key, name) + "/", &value);
    if (value.is<RpcValue::Struct>())
    {
      const std::string below = found->back().first;
      appendKeys(found, below, value.as<RpcValue::Struct>());
    }
  }
}

bool hasPrefix(const std::string& text, const std::string& prefix)
{
  return text.compare(0, prefix.size(), prefix) == 0;
}

}  // namespace

ParameterTree::SetResult ParameterTree::set(const std::string& key, RpcValue value)
{
  const std::vector<std::string_view> parts = nameParts(key);
  if (parts.size() > MAX_DEPTH)
  {
    return SetResult::TOO_DEEP;
  }
  if (parts.empty() && !value.is<RpcValue::Struct>())
  {
    return SetResult::ROOT_IS_NO_STRUCT;
  }
  RpcValue* at = &root_;
  for (const std::string_view part : parts)
  {
    if (!at->is<RpcValue::Struct>())
    {
      *at = RpcValue::Struct();
    }
    at = &at->as<RpcValue::Struct>()[std::string(part)];
  }
  *at = std::move(value);
  return SetResult::DONE;
}

const RpcValue* ParameterTree::get(const std::string& key) const
{
  const RpcValue* at = &root_;
  for (const std::string_view part : nameParts(key))
  {
    if (!at->is<RpcValue::Struct>())
    {
      return nullptr;
    }
    const RpcValue::Struct& members = at->as<RpcValue::Struct>();
    const auto found = members.find(part);
    if (found == members.end())
    {
      return nullptr;
    }
    at = &found->second;
  }
  return at;
}

bool ParameterTree::remove(const std::string& key)
{
  RpcValue* space = nullptr;
  RpcValue::Struct::iterator found;
  RpcValue* at = &root_;
  for (const std::string_view part : nameParts(key))
  {
    if (!at->is<RpcValue::Struct>())
    {
      return false;
    }
    space = at;
    found = space->as<RpcValue::Struct>().find(part);
    if (found == space->as<RpcValue::Struct>().end())
    {
      return false;
    }
    at = &found->second;
  }
  if (space == nullptr)
  {
    return false;
  }
  space->as<RpcValue::Struct>().erase(found);
  return true;
}

RpcValue::Array ParameterTree::names() const
{
  RpcValue::Array names;
  appendNames(&names, "/", root_.as<RpcValue::Struct>());
  return names;
}

std::optional<std::string> ParameterTree::search(const std::string& from, const std::string& key) const
{
  if (!key.empty() && key[0] == '/')
  {
    return get(key) != nullptr ? std::optional<std::string>(key) : std::nullopt;
  }
  const std::vector<std::string_view> parts = nameParts(key);
  std::vector<std::string_view> spaces = nameParts(from);
  while (!parts.empty())
  {
    std::string space = "/";
    for (const std::string_view part : spaces)
    {
      space.append(part).append("/");
    }
    if (get(space + std::string(parts[0])) != nullptr)
    {
      return space + key;
    }
    if (spaces.empty())
    {
      break;
    }
    spaces.pop_back();
  }
  return std::nullopt;
}

std::string parameterSubscriptionKey(const std::string& key)
{
  std::string result = canonicalName(key);
  if (result != "/")
  {
    result += '/';
  }
  return result;
}

std::vector<ParameterUpdate> parameterUpdates(const std::vector<std::string>& subscriptions, const std::string& key,
                                              const RpcValue& value)
{
  static const RpcValue UNSET{RpcValue::Struct()};
  std::vector<ParameterUpdate> updates;
  if (subscriptions.empty())
  {
    return updates;
  }
  const std::string changed = parameterSubscriptionKey(key);
  Found found;
  if (value.is<RpcValue::Struct>())
  {
    appendKeys(&found, changed, value.as<RpcValue::Struct>());
  }
  const std::map<std::string, const RpcValue*> below(found.begin(), found.end());
  for (const std::string& subscription : subscriptions)
  {
    if (hasPrefix(changed, subscription))
    {
      updates.push_back({subscription, changed, &value, true});
    }
    else if (value.is<RpcValue::Struct>() && hasPrefix(subscription, changed) && below.count(subscription) == 0)
    {
      updates.push_back({subscription, subscription, &UNSET, false});
    }
  }
  for (const std::string& subscription : subscriptions)
  {
    const auto exact = below.find(subscription);
    if (exact != below.end())
    {
      updates.push_back({subscription, subscription, exact->second, false});
    }
  }
  return updates;
}

}  // namespace pi_os_transport
