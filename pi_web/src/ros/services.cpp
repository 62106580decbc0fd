#include "ros/services.h"

#include "ros/known_types.h"

#include <algorithm>
#include <stdexcept>

namespace pi_web
{

using nlohmann::json;

std::vector<json> Services::update(const std::map<std::string, std::string>& types)
{
  std::vector<uint32_t> removed;
  std::vector<uint32_t> added;
  for (const auto& [id, service] : services_)
  {
    const auto type = types.find(service.name);
    if (type == types.end() || type->second != service.type)
    {
      removed.push_back(id);
    }
  }
  for (const uint32_t id : removed)
  {
    services_.erase(id);
  }
  for (const auto& [name, type] : types)
  {
    if (std::any_of(services_.begin(), services_.end(),
                    [&, &wanted = name](const auto& entry) { return entry.second.name == wanted; }))
    {
      continue;
    }
    if (!knownService(type))
    {
      warnings_->warn("service " + name + " is not offered: its type is " + type +
                      ", must be std_srvs/Empty, SetBool or Trigger");
      continue;
    }
    const auto [thread, fresh] = threads_.try_emplace(name, "web_call");
    if (fresh)
    {
      thread->second.start();
    }
    services_[++last_id_] = {name, type, &thread->second};
    added.push_back(last_id_);
  }
  std::vector<json> told;
  if (!removed.empty())
  {
    told.push_back({{"op", "unadvertiseServices"}, {"serviceIds", removed}});
  }
  if (!added.empty())
  {
    told.push_back(describe(added));
  }
  return told;
}

json Services::describe(const std::vector<uint32_t>& ids) const
{
  json list = json::array();
  for (const uint32_t id : ids)
  {
    const Service& service = services_.at(id);
    const auto schema = knownService(service.type);
    list.push_back({{"id", id},
                    {"name", service.name},
                    {"type", service.type},
                    {"requestSchema", schema->request},
                    {"responseSchema", schema->response}});
  }
  return {{"op", "advertiseServices"}, {"services", list}};
}

json Services::advertisement() const
{
  std::vector<uint32_t> ids;
  for (const auto& [id, service] : services_)
  {
    ids.push_back(id);
  }
  return describe(ids);
}

const Services::Service& Services::at(uint32_t id) const
{
  const auto service = services_.find(id);
  if (service == services_.end())
  {
    throw std::invalid_argument("service " + std::to_string(id) + " does not exist");
  }
  return service->second;
}

}  // namespace pi_web
