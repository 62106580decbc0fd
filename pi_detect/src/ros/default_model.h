#pragma once

#include <ros/package.h>

#include <string>

namespace pi_detect
{

/// The description of the suite's own network, in this package. Empty if ROS's environment does not know the package.
inline std::string defaultModel()
{
  const std::string package = ros::package::getPath("pi_detect");
  return package.empty() ? "" : package + "/config/models/ssd_street.yaml";
}

}  // namespace pi_detect
