#pragma once

#include <ros/console.h>
#include <ros/node_handle.h>

#include <functional>
#include <string>
#include <vector>

namespace pi_node
{

/// Reads a node's parameters, warns of unknown ones, logs all. Options has load() and toText().
/// @param name  of the log and of the file config/<name>.yaml; the same in every call for the same Options.
/// @throws what Options::load() throws.
template <typename Options>
Options loadNodeOptions(const ros::NodeHandle& private_node, const std::string& name)
{
  std::vector<std::string> unknown;
  Options options = Options::load(private_node, &unknown);
  for (const std::string& parameter : unknown)
  {
    ROS_WARN_STREAM_NAMED(name, "parameter " << parameter << " means nothing here; see config/" << name << ".yaml");
  }
  ROS_INFO_STREAM_NAMED(name, "parameters: " << options.toText());
  return options;
}

/// For the WarningBoard of a node: writes to the log of this name, the same in every call for the same Options.
template <typename Options>
std::function<void(bool error, const std::string& text)> warningLog(const std::string& name)
{
  return [name](bool error, const std::string& text)
  {
    if (error)
    {
      ROS_ERROR_STREAM_NAMED(name, text);
    }
    else
    {
      ROS_WARN_STREAM_NAMED(name, text);
    }
  };
}

}  // namespace pi_node
