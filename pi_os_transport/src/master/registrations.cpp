#include "master/registrations.h"

#include <algorithm>
#include <utility>

namespace pi_os_transport
{
namespace
{

constexpr size_t indexOf(Role role)
{
  return static_cast<size_t>(role);
}

/// Erases the providers for which `which` holds, and the entry with the last one. @return false if there is none
template <typename Table, typename Which>
bool eraseProvider(Table* table, typename Table::iterator entry, Which which)
{
  auto& providers = entry->second;
  const auto rest = std::remove_if(providers.begin(), providers.end(), which);
  const bool found = rest != providers.end();
  providers.erase(rest, providers.end());
  if (providers.empty())
  {
    table->erase(entry);
  }
  return found;
}

}  // namespace

bool Registrations::Node::isEmpty() const
{
  return std::all_of(keys.begin(), keys.end(), [](const auto& of_role) { return of_role.empty(); });
}

Registrations::Replaced Registrations::removeNode(const std::string& node)
{
  const auto found = nodes_.find(node);
  const std::set<std::string>& published = found->second.keys[indexOf(Role::PUBLISHER)];
  Replaced replaced{found->second.api, found->second.pid, {published.begin(), published.end()}};
  for (size_t role = 0; role < ROLES; ++role)
  {
    for (const std::string& key : found->second.keys[role])
    {
      const auto entry = tables_[role].find(key);
      if (entry != tables_[role].end())  // else another node had taken over this service and removed it
      {
        eraseProvider(&tables_[role], entry, [&](const Provider& one) { return one.node == node; });
      }
    }
  }
  for (const std::string& service : found->second.keys[indexOf(Role::SERVICE)])
  {
    const auto entry = service_apis_.find(service);
    if (entry != service_apis_.end() && entry->second.node == node)
    {
      service_apis_.erase(entry);
    }
  }
  nodes_.erase(found);
  return replaced;
}

std::optional<Registrations::Replaced> Registrations::add(Role role, const std::string& key, const std::string& node,
                                                          const std::string& api, const std::string& service_api)
{
  std::optional<Replaced> replaced;
  const auto known = nodes_.find(node);
  if (known != nodes_.end() && known->second.api != api)
  {
    replaced = removeNode(node);
  }
  Node& entry = nodes_[node];
  entry.api = api;
  const bool is_new = entry.keys[indexOf(role)].insert(key).second;
  std::vector<Provider>& providers = tables_[indexOf(role)][key];
  if (role == Role::SERVICE)
  {
    providers = {{node, api}};
    service_apis_[key] = {node, service_api};
    had_service_ = true;
  }
  else if (is_new)
  {
    providers.push_back({node, api});
  }
  return replaced;
}

Registrations::Removal Registrations::remove(Role role, const std::string& key, const std::string& node,
                                             const std::string& api)
{
  const auto known = nodes_.find(node);
  if (known == nodes_.end())
  {
    return {"[" + node + "] is not a registered node", 0};
  }
  Removal removal{"Unregistered [" + node + "] as provider of [" + key + "]", 1};
  Table& table = tables_[indexOf(role)];
  const auto entry = table.find(key);
  if (role == Role::SERVICE)
  {
    const auto service = service_apis_.find(key);
    if (!had_service_)
    {
      removal = {"[" + node + "] is not a provider of [" + key + "]", 0};
    }
    else if (service == service_apis_.end() || !(service->second == Provider{node, api}))
    {
      removal = {"[" + api + "] is no longer the current service api handle for [" + key + "]", 0};
    }
    else
    {
      service_apis_.erase(service);
      table.erase(entry);
    }
  }
  else if (entry == table.end() || !eraseProvider(&table, entry,
                                                  [&](const Provider& one) {
                                                    return one == Provider{node, api};
                                                  }))
  {
    removal = {"[" + node + "] is not a known provider of [" + key + "]", 0};
  }
  if (removal.count == 1)
  {
    known->second.keys[indexOf(role)].erase(key);
  }
  if (known->second.isEmpty())
  {
    nodes_.erase(known);
  }
  return removal;
}

const std::vector<Registrations::Provider>& Registrations::providers(Role role, const std::string& key) const
{
  static const std::vector<Provider> NONE;
  const auto found = tables_[indexOf(role)].find(key);
  return found == tables_[indexOf(role)].end() ? NONE : found->second;
}

RpcValue::Array Registrations::apis(Role role, const std::string& key) const
{
  RpcValue::Array result;
  for (const Provider& provider : providers(role, key))
  {
    result.emplace_back(provider.api);
  }
  return result;
}

const std::string* Registrations::nodeApi(const std::string& node) const
{
  const auto found = nodes_.find(node);
  return found == nodes_.end() ? nullptr : &found->second.api;
}

void Registrations::setPid(const std::string& node, const std::string& api, int pid)
{
  const auto found = nodes_.find(node);
  if (found != nodes_.end() && found->second.api == api)
  {
    found->second.pid = pid;
  }
}

bool Registrations::isInUse(const std::string& api) const
{
  return std::any_of(nodes_.begin(), nodes_.end(), [&api](const auto& entry) { return entry.second.api == api; });
}

const std::string* Registrations::serviceApi(const std::string& service) const
{
  const auto found = service_apis_.find(service);
  return found == service_apis_.end() ? nullptr : &found->second.api;
}

std::vector<std::string> Registrations::keys(Role role) const
{
  std::vector<std::string> result;
  for (const auto& [key, providers] : tables_[indexOf(role)])
  {
    result.push_back(key);
  }
  return result;
}

RpcValue::Array Registrations::state(Role role) const
{
  RpcValue::Array result;
  for (const auto& [key, providers] : tables_[indexOf(role)])
  {
    RpcValue::Array nodes;
    for (const Provider& provider : providers)
    {
      nodes.emplace_back(provider.node);
    }
    result.emplace_back(RpcValue::Array{key, std::move(nodes)});
  }
  return result;
}

}  // namespace pi_os_transport
