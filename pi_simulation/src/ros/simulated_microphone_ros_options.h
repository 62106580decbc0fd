#pragma once

#include "vehicle/microphone_mixer.h"

#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace pi_simulation
{

/// The parameters of the simulated microphone; config/simulated_microphone.yaml shows each with its unit.
struct SimulatedMicrophoneRosOptions
{
  MicrophoneMixerOptions mixer;
  std::string frame_id = "microphone";

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static SimulatedMicrophoneRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// The same with a tree as the parameter server has it. @param path  in front of names in messages.
  static SimulatedMicrophoneRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                                      std::vector<std::string>* unknown);
  /// All parameters as the parameter server would have them.
  XmlRpc::XmlRpcValue toParameters() const;
  /// The same in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_simulation
