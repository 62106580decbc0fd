#pragma once

#include <pi_node/vehicle_description.h>
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace pi_node
{

/// Base of the options of a node: reads them from the parameter server and writes them back.
///
/// The .cpp of the options includes parameter_tree.h, defines visitFields(options, visit) in the namespace of the
/// options, and instantiates this base: `template struct pi_node::NodeParameters<pi_slam::VioRosOptions>;`. The header
/// of the options declares that with `extern`.
///
/// Options with a method setVehicle(const VehicleDescription&) get the description of the vehicle
/// (vehicle_parameters.h) before their parameters are read and validated.
template <typename Options>
struct NodeParameters
{
  /// Reads and validates the private parameters of a node.
  /// @param[out] unknown  names of parameters that the node does not have.
  /// @throws std::invalid_argument naming the parameter, its value and its bound.
  static Options load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// The same from a tree of parameters. @param path  in front of names in messages.
  static Options fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                std::vector<std::string>* unknown);
  static Options fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                const VehicleDescription& vehicle, std::vector<std::string>* unknown);
  XmlRpc::XmlRpcValue toParameters() const;
  /// All parameters in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_node
