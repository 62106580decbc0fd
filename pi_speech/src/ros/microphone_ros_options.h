#pragma once

#include "audio/microphone.h"
#include "audio/sound_check.h"
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace pi_speech
{

/// The parameters of the microphone node; config/microphone.yaml shows each with its unit.
struct MicrophoneRosOptions
{
  MicrophoneOptions microphone;
  SoundCheckOptions check;  ///< but missing_s: the microphone says itself that it is gone
  std::string frame_id = "microphone";

  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static MicrophoneRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// The same with a tree as the parameter server has it. @param path  in front of names in messages.
  static MicrophoneRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                             std::vector<std::string>* unknown);
  /// All parameters as the parameter server would have them.
  XmlRpc::XmlRpcValue toParameters() const;
  /// The same in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_speech
