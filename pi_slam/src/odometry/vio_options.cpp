#include <pi_node/option_check.h>
#include "odometry/vio.h"

#include <stdexcept>

namespace pi_slam
{

void VioOptions::validate() const
{
  imu.validate();
  tracker.validate();
  initializer.validate();
  standstill.validate();
  window.validate();
  wheels.validate();
  const pi_node::OptionCheck check("vio");
  check.range("frame_budget_s", frame_budget_s, 0.0, 1.0);
  check.range("keyframe_parallax_px", keyframe_parallax_px, 1.0, 200.0);
  check.range("keyframe_tracked_ratio", keyframe_tracked_ratio, 0.05, 1.0);
  check.range("keyframe_max_interval_s", keyframe_max_interval_s, 0.1, 5.0);
  check.range("keyframe_min_interval_s", keyframe_min_interval_s, 0.0, 1.0);
  check.positive("max_speed", max_speed);
  check.range("max_blind_s", max_blind_s, 0.5, 60.0);
  check.range("readout_s", readout_s, 0.0, 0.1);
  if (keyframe_min_interval_s >= keyframe_max_interval_s)
  {
    throw std::invalid_argument(
        "vio/keyframe_min_interval_s = " + std::to_string(keyframe_min_interval_s) +
        ", must be below vio/keyframe_max_interval_s = " + std::to_string(keyframe_max_interval_s));
  }
}

const char* toString(VioStatus status)
{
  switch (status)
  {
    case VioStatus::INITIALIZING:
      return "initializing";
    case VioStatus::TRACKING:
      return "tracking";
    case VioStatus::STANDSTILL:
      return "standstill";
    case VioStatus::BLIND:
      return "blind";
    case VioStatus::LOST:
      return "lost";
  }
  return "unknown";
}

}  // namespace pi_slam
