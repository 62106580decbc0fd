#pragma once

#include <xmlrpcpp/XmlRpcValue.h>
#include <yaml-cpp/yaml.h>

#include <string>

namespace pi_node
{

/// As rosparam puts a YAML file on the parameter server; a value that is missing becomes an empty text.
inline XmlRpc::XmlRpcValue fromYaml(const YAML::Node& node)
{
  XmlRpc::XmlRpcValue value;
  if (node.IsMap())
  {
    value.begin();  // a struct, also without members
    for (const auto& member : node)
    {
      value[member.first.as<std::string>()] = fromYaml(member.second);
    }
  }
  else if (node.IsSequence())
  {
    value.setSize(static_cast<int>(node.size()));
    for (size_t i = 0; i < node.size(); ++i)
    {
      value[static_cast<int>(i)] = fromYaml(node[i]);
    }
  }
  else if (bool flag; node.Tag() != "!" && YAML::convert<bool>::decode(node, flag))
  {
    value = flag;
  }
  else if (int number; node.Tag() != "!" && YAML::convert<int>::decode(node, number))
  {
    value = number;
  }
  else if (double real; node.Tag() != "!" && YAML::convert<double>::decode(node, real))
  {
    value = real;
  }
  else
  {
    value = node.IsNull() ? std::string() : node.as<std::string>();
  }
  return value;
}

}  // namespace pi_node
