#pragma once

#include <pi_node/ros/yaml_parameters.h>

#include <set>
#include <string>

namespace pi_node::test_support
{

using pi_node::fromYaml;

inline void collectNames(XmlRpc::XmlRpcValue tree, const std::string& path, std::set<std::string>* names)
{
  for (auto& [name, value] : tree)
  {
    if (value.getType() == XmlRpc::XmlRpcValue::TypeStruct)
    {
      collectNames(value, path + name + "/", names);
    }
    else
    {
      names->insert(path + name);
    }
  }
}

}  // namespace pi_node::test_support
