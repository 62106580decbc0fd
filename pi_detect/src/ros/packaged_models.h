#pragma once

#include <ros/package.h>

#include <string>

namespace pi_detect
{

/// The folder of this package's descriptions of networks. Empty if ROS's environment does not know the package.
inline std::string packagedModels()
{
  const std::string package = ros::package::getPath("pi_detect");
  return package.empty() ? "" : package + "/config/models";
}

}  // namespace pi_detect
