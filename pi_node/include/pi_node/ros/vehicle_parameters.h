#pragma once

#include <pi_node/vehicle_description.h>
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>

namespace pi_node
{

/// The description of the vehicle on the parameter server: `vehicle` in the node's private namespace, or in the nearest
/// one above.
/// @throws std::invalid_argument naming the parameter, its value and its bound; for none also the way out.
VehicleDescription loadVehicle(const ros::NodeHandle& private_node);

/// The same from a tree of parameters: every field is needed, others are refused. @param path  in front of names in
/// messages.
VehicleDescription vehicleFromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path);
XmlRpc::XmlRpcValue toParameters(const VehicleDescription& vehicle);

}  // namespace pi_node
