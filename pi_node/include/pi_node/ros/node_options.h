#pragma once

#include <ros/console.h>
#include <ros/node_handle.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

namespace pi_node
{

/// Reads a node's parameters, warns of unknown ones, logs all. Options has load() and toText().
/// @param name  of the log and of the file config/<file>.yaml; the same in every call for the same Options.
/// @param kept  private parameters that the node itself left on the server.
/// @param file  empty: that of the log's name.
/// @throws what Options::load() throws.
template <typename Options>
Options loadNodeOptions(const ros::NodeHandle& private_node, const std::string& name,
                        const std::vector<std::string>& kept = {}, const std::string& file = "")
{
  std::vector<std::string> unknown;
  Options options = Options::load(private_node, &unknown);
  for (const std::string& parameter : unknown)
  {
    const auto has_it = [&](const std::string& own)
    { return (parameter + "/").rfind(private_node.resolveName(own) + "/", 0) == 0; };
    if (std::none_of(kept.begin(), kept.end(), has_it))
    {
      ROS_WARN_STREAM_NAMED(name, "parameter " << parameter << " means nothing here; see config/"
                                               << (file.empty() ? name : file) << ".yaml");
    }
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
