#pragma once

#include <pi_node/ros/node_parameters.h>
#include <pi_node/ros/parameter_values.h>
#include <pi_node/ros/vehicle_parameters.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace pi_node
{

/// All parameters of a node to and from its options. The namespace of the options has a function
/// visitFields(options, visit), which calls visit(path, field) for each field. The namespace of a field's type has
/// read(value, &field) and write(field); those for numbers, texts, durations and lists are in parameter_values.h.
namespace parameter_tree
{

using XmlRpc::XmlRpcValue;
using Scores = std::map<std::string, float>;

constexpr double MAX_DURATION_S = 3600.0;

using parameters::read;
using parameters::write;

/// Reads a parameter, if it is set, and removes it from the leaves.
template <typename Field>
void take(const std::string& name, std::map<std::string, XmlRpcValue>* leaves, Field* field)
{
  const auto leaf = leaves->find(name);
  if (leaf == leaves->end())
  {
    return;
  }
  try
  {
    read(leaf->second, field);
  }
  catch (const std::invalid_argument& error)
  {
    const std::string problem = error.what();
    throw std::invalid_argument(name + (problem[0] == ':' ? "" : " ") + problem);
  }
  leaves->erase(leaf);
}

/// All leaves that begin with the name are entries of the map.
inline void take(const std::string& name, std::map<std::string, XmlRpcValue>* leaves, Scores* field)
{
  if (const auto leaf = leaves->find(name); leaf != leaves->end())
  {
    throw std::invalid_argument(name + " = " + parameters::text(leaf->second) + ", must be a map of labels to scores");
  }
  const std::string prefix = name + "/";
  for (auto leaf = leaves->lower_bound(prefix); leaf != leaves->end() && leaf->first.rfind(prefix, 0) == 0;)
  {
    const std::string path = leaf->first;
    ++leaf;
    take(path, leaves, &(*field)[path.substr(prefix.size())]);
  }
}

template <typename Options, typename = void>
struct TakesVehicle : std::false_type
{
};
template <typename Options>
struct TakesVehicle<Options, std::void_t<decltype(std::declval<Options&>().setVehicle(VehicleDescription()))>>
  : std::true_type
{
};

/// @param tree     of the parameter server.
/// @param path     in front of names in messages.
/// @param unknown  gets the names of unknown parameters.
/// @param options  with the values of parameters that are not set.
/// @throws std::invalid_argument "parameter path name = value, must be bound".
template <typename Options>
Options load(const XmlRpcValue& tree, const std::string& path, std::vector<std::string>* unknown,
             Options options = Options())
{
  std::map<std::string, XmlRpcValue> leaves;
  if (tree.getType() == XmlRpcValue::TypeStruct)
  {
    parameters::flatten(tree, "", &leaves);
  }
  try
  {
    visitFields(options, [&leaves](const char* name, auto& field) { take(name, &leaves, &field); });
    options.validate();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument("parameter " + path + error.what());
  }
  for (const auto& [name, value] : leaves)
  {
    unknown->push_back(path + name);
  }
  return options;
}

template <typename Options>
XmlRpcValue save(Options options)
{
  XmlRpcValue tree;
  const auto put = [&tree](const std::string& name, const XmlRpcValue& value)
  {
    const size_t slash = name.find('/');
    (slash == std::string::npos ? tree[name] : tree[name.substr(0, slash)][name.substr(slash + 1)]) = value;
  };
  visitFields(options,
              [&put](const std::string& name, const auto& field)
              {
                if constexpr (std::is_same_v<std::decay_t<decltype(field)>, Scores>)
                {
                  for (const auto& [label, score] : field)
                  {
                    put(name + "/" + label, write(score));
                  }
                }
                else
                {
                  put(name, write(field));
                }
              });
  return tree;
}

/// Validates a group of options.
template <typename Part>
void validateGroup(const std::string& group, const Part& part)
{
  try
  {
    part.validate();
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(group + "/" + error.what());
  }
}

inline void requireDuration(const char* name, double value)
{
  parameters::require(value > 0.0 && value <= MAX_DURATION_S, name, value, "in (0, 3600]");
}

}  // namespace parameter_tree

template <typename Options>
Options NodeParameters<Options>::load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown)
{
  XmlRpc::XmlRpcValue tree;
  const std::string& path = private_node.getNamespace();
  private_node.getParam(path, tree);
  if constexpr (parameter_tree::TakesVehicle<Options>::value)
  {
    Options options = Options::fromParameters(tree, path + "/", loadVehicle(private_node), unknown);
    const auto described = [&](const std::string& name) { return name.rfind(path + "/vehicle/", 0) == 0; };
    unknown->erase(std::remove_if(unknown->begin(), unknown->end(), described), unknown->end());
    return options;
  }
  else
  {
    return Options::fromParameters(tree, path + "/", unknown);  // which the options may have replaced
  }
}

template <typename Options>
Options NodeParameters<Options>::fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                                const VehicleDescription& vehicle, std::vector<std::string>* unknown)
{
  Options options;
  if constexpr (parameter_tree::TakesVehicle<Options>::value)
  {
    options.setVehicle(vehicle);
  }
  return parameter_tree::load<Options>(tree, path, unknown, std::move(options));
}

template <typename Options>
Options NodeParameters<Options>::fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                                std::vector<std::string>* unknown)
{
  return parameter_tree::load<Options>(tree, path, unknown);
}

template <typename Options>
XmlRpc::XmlRpcValue NodeParameters<Options>::toParameters() const
{
  return parameter_tree::save(static_cast<const Options&>(*this));
}

template <typename Options>
std::string NodeParameters<Options>::toText() const
{
  return parameters::text(static_cast<const Options&>(*this).toParameters());
}

}  // namespace pi_node
