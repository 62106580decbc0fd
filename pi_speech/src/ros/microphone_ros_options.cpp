#include "ros/microphone_ros_options.h"
#include <pi_node/ros/parameter_tree.h>

namespace pi_speech
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(MicrophoneRosOptions& options, Visitor&& visit)
{
  auto& microphone = options.microphone;
  visit("device", microphone.device);
  visit("sample_rate", microphone.format.sample_rate_hz);
  visit("channels", microphone.format.channels);
  visit("period_s", microphone.period_s);
  visit("buffer_s", microphone.buffer_s);
  visit("stall_s", microphone.stall_s);
  visit("retry_s", microphone.retry_s);
  visit("check/clipped_share", options.check.clipped_share);
  visit("check/silent_level_dbfs", options.check.silent_level_dbfs);
  visit("check/silent_s", options.check.silent_s);
  visit("check/window_s", options.check.window_s);
  visit("frame_id", options.frame_id);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void MicrophoneRosOptions::validate() const
{
  microphone.validate();
  parameter_tree::validateGroup("check", check);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_speech

template struct pi_node::NodeParameters<pi_speech::MicrophoneRosOptions>;
