#pragma once

#include <pi_node/ros/node_parameters.h>
#include <pi_node/ros/parameter_values.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <cstdio>
#include <map>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace pi_node
{

/// Options from parameters and back. Options name their fields in a function visitFields(options, visit), found by
/// their type, that calls visit(path, field) for each; fields of a type of their own have read(value, &field) and
/// write(field), found by that type.
namespace parameter_tree
{

using XmlRpc::XmlRpcValue;
using Scores = std::map<std::string, float>;

constexpr double MAX_DURATION_S = 3600.0;

inline void read(XmlRpcValue value, float* field)
{
  double number = 0.0;
  parameters::read(value, &number);
  *field = static_cast<float>(number);
}

inline void read(XmlRpcValue value, std::vector<std::string>* field)
{
  parameters::requireType(value, XmlRpcValue::TypeArray, "a list of texts");
  field->assign(static_cast<size_t>(value.size()), "");
  for (int i = 0; i < value.size(); ++i)
  {
    parameters::read(value[i], &(*field)[static_cast<size_t>(i)]);
  }
}

inline void read(XmlRpcValue value, std::vector<double>* field)
{
  parameters::requireType(value, XmlRpcValue::TypeArray, "a list of numbers");
  field->assign(static_cast<size_t>(value.size()), 0.0);
  for (int i = 0; i < value.size(); ++i)
  {
    parameters::read(value[i], &(*field)[static_cast<size_t>(i)]);
  }
}

/// With the digits that a float has.
inline XmlRpcValue write(float field)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.7g", static_cast<double>(field));
  return XmlRpcValue(std::stod(text));
}

template <typename Element>
XmlRpcValue write(const std::vector<Element>& field)
{
  XmlRpcValue value;
  value.setSize(static_cast<int>(field.size()));
  for (size_t i = 0; i < field.size(); ++i)
  {
    value[static_cast<int>(i)] = field[i];
  }
  return value;
}

/// Takes a parameter out of the leaves, if it is there.
template <typename Field>
void take(const std::string& name, std::map<std::string, XmlRpcValue>* leaves, Field* field)
{
  using parameter_tree::read;
  using parameters::read;
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
    throw std::invalid_argument(name + " " + error.what());
  }
  leaves->erase(leaf);
}

/// A map is whatever begins with its name.
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

/// @param tree     as the parameter server has it.
/// @param path     in front of names in messages.
/// @param unknown  gets the names of parameters that mean nothing.
/// @throws std::invalid_argument "parameter path name = value, must be bound".
template <typename Options>
Options load(const XmlRpcValue& tree, const std::string& path, std::vector<std::string>* unknown)
{
  Options options;
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
XmlRpcValue save(const Options& options)
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
                using parameter_tree::write;
                using parameters::write;
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

/// Validates options that stand in a group.
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
  return fromParameters(tree, path + "/", unknown);
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
  return parameters::text(toParameters());
}

}  // namespace pi_node
