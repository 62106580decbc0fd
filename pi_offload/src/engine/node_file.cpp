#include "engine/node_file.h"

#include <pi_node/yaml_section.h>

#include <limits>
#include <set>
#include <stdexcept>

namespace pi_offload
{
namespace
{

NodeDescription readNode(pi_node::YamlSection* section)
{
  NodeDescription node;
  node.range_m = std::numeric_limits<double>::infinity();
  section->read("id", "a text", &node.id);
  section->read("address", "host:port", &node.address);
  section->read("x", "a number [m]", &node.position.x);
  section->read("y", "a number [m]", &node.position.y);
  section->read("range", "a number [m]", &node.range_m);
  section->read("frequency_ghz", "a number", &node.frequency_ghz);
  section->finish();
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
  try
  {
    for (pi_node::YamlSection& section : pi_node::YamlSection::load(path).list("nodes"))
    {
      nodes.push_back(readNode(&section));
    }
    requireUniqueIds(nodes);
  }
  catch (const std::exception& error)
  {
    const std::string text = error.what();
    throw std::runtime_error(text.rfind(path, 0) == 0 ? text : path + ": " + text);
  }
  return nodes;
}

}  // namespace pi_offload
