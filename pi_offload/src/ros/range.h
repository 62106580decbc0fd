#pragma once

#include <pi_node/ros/parameter_values.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_offload
{

/// Range of a node's network [m]: in files and parameters a number or "inf", because the parameter server's protocol
/// has no infinite numbers.
struct Range
{
  double metres = std::numeric_limits<double>::infinity();
};

inline void read(const XmlRpc::XmlRpcValue& value, Range* field)
{
  if (value.getType() != XmlRpc::XmlRpcValue::TypeString)
  {
    pi_node::parameters::read(value, &field->metres);
    return;
  }
  std::string text;
  pi_node::parameters::read(value, &text);
  if (text != "inf")
  {
    throw std::invalid_argument("= \"" + text + "\", must be a number [m], or inf");
  }
  field->metres = std::numeric_limits<double>::infinity();
}

inline XmlRpc::XmlRpcValue write(const Range& field)
{
  return std::isfinite(field.metres) ? XmlRpc::XmlRpcValue(field.metres) : XmlRpc::XmlRpcValue("inf");
}

}  // namespace pi_offload
