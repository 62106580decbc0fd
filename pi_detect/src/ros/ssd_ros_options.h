#pragma once

#include <pi_detect/object_tracker.h>
#include <pi_detect/ssd_detector.h>
#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <string>
#include <vector>

namespace pi_detect
{

/// The parameters of the ssd node; config/ssd.yaml shows each with its unit.
struct SsdRosOptions
{
  std::string model;         ///< YAML file of the model, absolute; empty: the package's ssd_street.yaml
  DetectorOptions detector;  ///< its filter is that of `detections`
  bool use_runtime = true;   ///< tasks of pi_runtime::Runtime::shared(); false: plain calls
  ObjectTrackerOptions tracker;

  bool zero_copy = true;  ///< raw pictures are read where their publisher wrote them, if the transport can
  std::string image_transport = "raw";  ///< of `image`
  bool always_on = false;               ///< also while nobody listens
  double max_rate_hz = 0.0;             ///< pictures that come faster are left out [Hz]; 0: none is

  double input_timeout_s = 2.0;    ///< without a picture, after which there is a warning [s]
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// Options of the detector, whose thresholds are lowered to those of the tracker, which follows objects through
  /// pictures where they score low.
  DetectorOptions detectorOptions(const ModelDescription& model) const;

  /// Reads the private parameters of a node, and validates.
  /// @param[out] unknown  names of parameters that mean nothing here.
  /// @throws std::invalid_argument naming the parameter that is wrong, its value and its bound.
  static SsdRosOptions load(const ros::NodeHandle& private_node, std::vector<std::string>* unknown);
  /// The same with a tree as the parameter server has it. @param path  in front of names in messages.
  static SsdRosOptions fromParameters(const XmlRpc::XmlRpcValue& tree, const std::string& path,
                                      std::vector<std::string>* unknown);
  /// All parameters as the parameter server would have them.
  XmlRpc::XmlRpcValue toParameters() const;
  /// The same in one line, for the log.
  std::string toText() const;
};

}  // namespace pi_detect
