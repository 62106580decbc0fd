#include "ros/ssd_ros_options.h"
#include <pi_node/ros/parameter_tree.h>

#include <algorithm>

namespace pi_detect
{

namespace parameter_tree = pi_node::parameter_tree;
using pi_node::parameters::require;
using XmlRpc::XmlRpcValue;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(SsdRosOptions& options, Visitor&& visit)
{
  auto& detector = options.detector;
  auto& filter = detector.filter;
  visit("model", options.model);
  visit("target", detector.target);
  visit("require_target", detector.require_target);
  visit("threads", detector.threads);
  visit("use_runtime", options.use_runtime);
  visit("check_model", detector.check_model);
  visit("check/timeout_s", detector.check.timeout_s);
  visit("check/memory_limit_mb", detector.check.memory_limit_mb);
  visit("score_threshold", filter.score_threshold);
  visit("class_thresholds", filter.class_thresholds);
  visit("classes", filter.classes);
  visit("class_agnostic_overlap", filter.class_agnostic_overlap);
  visit("max_detections", filter.max_detections);
  visitTrackerFields(options.tracker, visit);
  visit("tracker/picture_motion", options.picture_motion);
  visit("zero_copy", options.zero_copy);
  visit("image_transport", options.image_transport);
  visit("always_on", options.always_on);
  visit("max_rate_hz", options.max_rate_hz);
  visit("input_timeout_s", options.input_timeout_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static void read(const XmlRpcValue& value, Target* field)
{
  pi_node::parameters::readChoice(value, {Target::CPU, Target::OPENCL, Target::OPENCL_FP16}, field);
}

void SsdRosOptions::validate() const
{
  require(!isModelPath(model) || model.front() == '/', "model", "\"" + model + "\"",
          "the name of a network or an absolute path: a node's working folder is not its user's");
  detector.validate();
  parameter_tree::validateGroup("tracker", tracker);
  require(!image_transport.empty(), "image_transport", "\"\"", "the name of a transport, as raw or compressed");
  require(max_rate_hz >= 0.0 && max_rate_hz <= 1000.0, "max_rate_hz", max_rate_hz, "in [0, 1000]");
  parameter_tree::requireDuration("input_timeout_s", input_timeout_s);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

DetectorOptions SsdRosOptions::detectorOptions(const ModelDescription& model) const
{
  DetectorOptions lowered = detector;
  const auto low_score = static_cast<float>(tracker.forNetwork(model.tracker).scores.low);
  DetectionFilter& filter = lowered.filter;
  filter.score_threshold =
      std::min(low_score, filter.score_threshold > 0.0F ? filter.score_threshold : model.score_threshold);
  for (auto& [label, threshold] : filter.class_thresholds)
  {
    threshold = std::min(low_score, threshold);
  }
  return lowered;
}

}  // namespace pi_detect

template struct pi_node::NodeParameters<pi_detect::SsdRosOptions>;
