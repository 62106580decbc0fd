#pragma once

#include <ros/ros.h>

#include <stdexcept>
#include <string>

namespace pi_bringup
{

/// Sets *value if the parameter exists. @throws std::invalid_argument if it exists with another type, which
/// NodeHandle::getParam() would pass over in silence.
template <typename Value>
void loadParameter(const ros::NodeHandle& node, const std::string& name, Value* value)
{
  if (node.hasParam(name) && !node.getParam(name, *value))
  {
    throw std::invalid_argument("parameter " + node.resolveName(name) +
                                " has the wrong type; config/default.yaml shows the one it must have");
  }
}

/// For the validate() of options. @throws std::invalid_argument "<field> = <value>, must be <bound>" unless valid.
inline void checkOption(bool valid, const std::string& field, const std::string& value, const std::string& bound)
{
  if (!valid)
  {
    throw std::invalid_argument(field + " = " + value + ", must be " + bound);
  }
}

}  // namespace pi_bringup
