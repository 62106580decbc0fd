#include "engine/node_file.h"
#include <yaml-cpp/yaml.h>

#include <exception>
#include <limits>
#include <set>
#include <stdexcept>

namespace pi_offload
{
namespace
{

template <typename Value>
void take(const YAML::Node& node, const char* key, const char* what, Value* value)
{
  const YAML::Node found = node[key];
  if (!found)
  {
    return;
  }
  if (!found.IsScalar() || !YAML::convert<Value>::decode(found, *value))
  {
    throw std::invalid_argument(std::string(key) + " = " + YAML::Dump(found) + ", must be " + what);
  }
}

NodeDescription nodeOf(const YAML::Node& entry)
{
  if (!entry.IsMap())
  {
    throw std::invalid_argument("= " + YAML::Dump(entry) + ", must be a map with id, address, x, y and range");
  }
  static const std::set<std::string> KEYS{"id", "address", "x", "y", "range", "frequency_ghz"};
  for (const auto& member : entry)
  {
    const auto key = member.first.as<std::string>("");
    if (KEYS.count(key) == 0)
    {
      throw std::invalid_argument("key " + key +
                                  " means nothing here; there are id, address, x, y, range and "
                                  "frequency_ghz");
    }
  }
  NodeDescription node;
  node.range_m = std::numeric_limits<double>::infinity();
  take(entry, "id", "a text", &node.id);
  take(entry, "address", "host:port", &node.address);
  take(entry, "x", "a number [m]", &node.position.x);
  take(entry, "y", "a number [m]", &node.position.y);
  take(entry, "range", "a number [m]", &node.range_m);
  take(entry, "frequency_ghz", "a number", &node.frequency_ghz);
  node.validate();
  return node;
}

}  // namespace

void requireUniqueIds(const std::vector<NodeDescription>& nodes)
{
  std::set<std::string> ids;
  for (const NodeDescription& node : nodes)
  {
    if (!ids.insert(node.id).second)
    {
      throw std::invalid_argument("id " + node.id + " comes twice, must be unique");
    }
  }
}

std::vector<NodeDescription> loadNodeFile(const std::string& path)
{
  std::vector<NodeDescription> nodes;
  size_t number = 0;
  try
  {
    const YAML::Node file = YAML::LoadFile(path);
    const YAML::Node list = file.IsMap() ? file["nodes"] : YAML::Node();
    if (!list.IsDefined() || !list.IsSequence())
    {
      throw std::invalid_argument("there is no list nodes");
    }
    for (const YAML::Node& entry : list)
    {
      ++number;
      nodes.push_back(nodeOf(entry));
    }
    number = 0;
    requireUniqueIds(nodes);
  }
  catch (const YAML::BadFile&)
  {
    throw std::runtime_error(path + ": cannot be read; it must be a YAML file with a list nodes");
  }
  catch (const std::exception& error)
  {
    throw std::runtime_error(path + ": " + (number > 0 ? "node " + std::to_string(number) + ": " : "") + error.what());
  }
  return nodes;
}

}  // namespace pi_offload
