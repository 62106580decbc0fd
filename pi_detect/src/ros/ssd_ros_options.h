#pragma once

#include <pi_detect/detector.h>
#include <pi_detect/model_catalogue.h>
#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

#include "ros/tracker_parameters.h"

namespace pi_detect
{

/// The parameters of the ssd node; config/ssd.yaml shows each with its unit.
struct SsdRosOptions : pi_node::NodeParameters<SsdRosOptions>
{
  std::string model = DEFAULT_MODEL;  ///< name of a network in config/models, or absolute path of a YAML file
  DetectorOptions detector;           ///< its filter is that of `detections`
  bool use_runtime = true;            ///< a stage of pi_runtime::Runtime::shared(); false: plain calls
  TrackerParameters tracker;
  bool picture_motion = true;  ///< where tf does not tell how the camera turned, pictures do

  bool zero_copy = true;                ///< read raw pictures in the publisher's memory, if the transport can
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
};

}  // namespace pi_detect

extern template struct pi_node::NodeParameters<pi_detect::SsdRosOptions>;
