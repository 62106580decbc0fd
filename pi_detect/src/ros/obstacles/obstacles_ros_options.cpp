#include "ros/obstacles/obstacles_ros_options.h"
#include <pi_node/ros/parameter_tree.h>

namespace pi_detect
{

namespace parameter_tree = pi_node::parameter_tree;
using pi_node::parameters::require;
using XmlRpc::XmlRpcValue;

const char* toString(StereoSource source)
{
  switch (source)
  {
    case StereoSource::RECTIFIED:
      return "rectified";
    case StereoSource::RAW:
      return "raw";
    case StereoSource::DISPARITY:
      return "disparity";
  }
  return "?";
}

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(ObstaclesRosOptions& options, Visitor&& visit)
{
  auto& stereo = options.stereo;
  auto& tracker = options.tracker;
  visit("source", options.source);
  visit("zero_copy", options.zero_copy);
  visit("image_transport", options.image_transport);
  visit("pair_tolerance_s", options.pair_tolerance_s);
  visit("max_rate_hz", options.max_rate_hz);
  visit("always_on", options.always_on);
  visit("use_runtime", options.use_runtime);
  visit("base_link_frame", options.base_link_frame);
  visit("odom_frame", options.odom_frame);
  visit("tf_wait_s", options.tf_wait_s);
  visit("tracks_rectified", options.tracks_rectified);
  visit("max_track_age_s", options.max_track_age_s);
  visit("stereo/max_range_m", stereo.max_range_m);
  visit("stereo/ground_z_m", stereo.ground_z_m);
  visit("stereo/min_height_m", stereo.min_height_m);
  visit("stereo/max_height_m", stereo.max_height_m);
  visit("stereo/min_size_m", stereo.min_size_m);
  visit("stereo/max_ground_tilt", stereo.max_ground_tilt);
  visit("stereo/max_ground_step_m", stereo.max_ground_step_m);
  visit("stereo/nearest_distance_m", stereo.nearest_distance_m);
  visit("tracker/time_to_live_s", tracker.time_to_live_s);
  visit("tracker/memory_s", tracker.memory_s);
  visit("tracker/confirm_hits", tracker.confirm_hits);
  visit("tracker/acceleration_m_s2", tracker.acceleration_m_s2);
  visit("tracker/max_speed_m_s", tracker.max_speed_m_s);
  visit("tracker/min_label_overlap", tracker.min_label_overlap);
  visit("grid/cell_m", options.grid.cell_m);
  visit("grid/size_m", options.grid.size_m);
  visit("grid/memory_s", options.grid.memory_s);
  visit("grid/max_sigma_m", options.grid.max_sigma_m);
  visit("grid/rate_hz", options.grid.rate_hz);
  visit("grid/leaves_out", options.grid_leaves_out);
  visit("min_coverage", options.min_coverage);
  visit("marker_lifetime_s", options.marker_lifetime_s);
  visit("input_timeout_s", options.input_timeout_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static void read(const XmlRpcValue& value, StereoSource* field)
{
  pi_node::parameters::readChoice(value, {StereoSource::RECTIFIED, StereoSource::RAW, StereoSource::DISPARITY}, field);
}

static void requireFrame(const char* name, const std::string& frame)
{
  require(!frame.empty() && frame.front() != '/', name, "\"" + frame + "\"", "a frame name without leading /");
}

void ObstaclesRosOptions::validate() const
{
  require(!image_transport.empty(), "image_transport", "\"\"", "the name of a transport, as raw or compressed");
  require(pair_tolerance_s >= 0.0 && pair_tolerance_s <= 0.1, "pair_tolerance_s", pair_tolerance_s, "in [0, 0.1]");
  require(max_rate_hz >= 0.0 && max_rate_hz <= 1000.0, "max_rate_hz", max_rate_hz, "in [0, 1000]");
  requireFrame("base_link_frame", base_link_frame);
  requireFrame("odom_frame", odom_frame);
  require(odom_frame != base_link_frame, "odom_frame", "\"" + odom_frame + "\"", "another frame than base_link_frame");
  require(tf_wait_s >= 0.0 && tf_wait_s <= 10.0, "tf_wait_s", tf_wait_s, "in [0, 10]");
  require(max_track_age_s >= 0.0 && max_track_age_s <= 10.0, "max_track_age_s", max_track_age_s, "in [0, 10]");
  require(source != StereoSource::DISPARITY || tracks_rectified, "tracks_rectified", "false",
          "true with source = disparity");
  parameter_tree::validateGroup("stereo", stereo);
  parameter_tree::validateGroup("tracker", tracker);
  parameter_tree::validateGroup("grid", grid);
  require(stereo.max_height_m >= stereo.footprint.height, "stereo/max_height_m", stereo.max_height_m,
          "at least vehicle/footprint/height");
  require(min_coverage >= 0.0 && min_coverage <= 1.0, "min_coverage", min_coverage, "in [0, 1]");
  parameter_tree::requireDuration("marker_lifetime_s", marker_lifetime_s);
  parameter_tree::requireDuration("input_timeout_s", input_timeout_s);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_detect

template struct pi_node::NodeParameters<pi_detect::ObstaclesRosOptions>;
