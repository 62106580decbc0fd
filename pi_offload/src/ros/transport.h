#pragma once

#include <pi_node/ros/parameter_values.h>

#include "wire/requester.h"

namespace pi_offload
{

inline void read(const XmlRpc::XmlRpcValue& value, Transport* field)
{
  pi_node::parameters::readChoice(value, {Transport::DIRECT, Transport::NATS}, field);
}

}  // namespace pi_offload
