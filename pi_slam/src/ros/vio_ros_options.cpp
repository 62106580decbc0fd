#include "ros/vio_ros_options.h"

#include <pi_node/ros/parameter_tree.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <variant>

#include "odometry/vio_options_yaml.h"

namespace pi_slam
{

using pi_node::parameter_tree::requireDuration;
using pi_node::parameters::require;
using XmlRpc::XmlRpcValue;

namespace
{

constexpr double MAX_DURATION_S = 3600.0;
constexpr double MAX_TF_RATE_HZ = 4000.0;

void requireFrame(const char* name, const std::string& frame)
{
  require(!frame.empty() && frame.front() != '/', name, "\"" + frame + "\"", "a frame name without leading /");
}

}  // namespace

/// Every parameter by the path of its name, with its field; found by parameter_tree.
template <typename Visitor>
static void visitFields(VioRosOptions& options, Visitor&& visit)
{
  // optionFields() gives fields that can be written to; visit() writes only to those of options that are not const.
  auto& fields = const_cast<VioRosOptions&>(options);
  for (const OptionField& core_field : optionFields(&fields.vio, &fields.mapper))
  {
    std::visit([&](auto* field) { visit(core_field.key.c_str(), *field); }, core_field.value);
  }
  auto& calibration = options.calibration;
  visit("calibration/source", calibration.source);
  visit("calibration/camchain", calibration.camchain);
  visit("calibration/imu_yaml", calibration.imu_yaml);
  visit("calibration/euroc_folder", calibration.euroc_folder);
  visit("calibration/rectified", calibration.rectified);
  visit("calibration/imu_in_base", calibration.imu_in_base);
  visit("calibration/left_in_imu", calibration.left_in_imu);
  visit("calibration/refined_camchain", calibration.refined_camchain);
  visit("calibration/refined_imu", calibration.refined_imu);
  visit("map_frame", options.map_frame);
  visit("odom_frame", options.odom_frame);
  visit("base_link_frame", options.base_link_frame);
  visit("earth_frame", options.earth_frame);
  visit("publish_tf", options.publish_tf);
  visit("publish_map_tf", options.publish_map_tf);
  visit("tf_rate_hz", options.tf_rate_hz);
  visit("use_runtime", options.use_runtime);
  visit("mapping", options.mapping);
  visit("map_file", options.map_file);
  visit("save_map", options.save_map);
  visit("wheel_topic", options.wheel_topic);
  visit("gnss_topic", options.gnss_topic);
  visit("gnss_antenna", options.gnss_antenna);
  visit("zero_copy", options.zero_copy);
  visit("queue_size", options.queue_size);
  visit("imu_queue_size", options.imu_queue_size);
  visit("pair_tolerance_s", options.pair_tolerance_s);
  visit("pair_wait_s", options.pair_wait_s);
  visit("imu_wait_s", options.imu_wait_s);
  visit("time_jump_s", options.time_jump_s);
  visit("input_timeout_s", options.input_timeout_s);
  visit("max_delay_s", options.max_delay_s);
  visit("path_spacing_m", options.path_spacing_m);
  visit("path_length", options.path_length);
  visit("path_period_s", options.path_period_s);
  visit("points_period_s", options.points_period_s);
  visit("map_period_s", options.map_period_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static void read(const XmlRpcValue& value, CalibrationSource* field)
{
  pi_node::parameters::readChoice(
      value, {CalibrationSource::CAMERA_INFO, CalibrationSource::KALIBR, CalibrationSource::EUROC}, field);
}

void VioRosOptions::validate() const
{
  vio.validate();
  mapper.validate();
  calibration.validate();
  require(use_runtime || !(vio.tracker.kernel_tasks || mapper.kernel_tasks), "use_runtime", "false",
          "true with tracker/kernel_tasks or map/kernel_tasks");
  requireFrame("map_frame", map_frame);
  requireFrame("odom_frame", odom_frame);
  requireFrame("base_link_frame", base_link_frame);
  require(std::set<std::string>{map_frame, odom_frame, base_link_frame}.size() == 3, "odom_frame",
          "\"" + odom_frame + "\"", "another frame than map_frame and base_link_frame, which differ too");
  requireFrame("earth_frame", earth_frame);
  require(std::set<std::string>{map_frame, odom_frame, base_link_frame}.count(earth_frame) == 0, "earth_frame",
          "\"" + earth_frame + "\"", "another frame than map_frame, odom_frame and base_link_frame");
  require(mapping || gnss_topic.empty(), "gnss_topic", "\"" + gnss_topic + "\"", "empty with mapping = false");
  require(gnss_antenna.size() == 3 && std::all_of(gnss_antenna.begin(), gnss_antenna.end(),
                                                  [](double value) { return std::abs(value) <= 100.0; }),
          "gnss_antenna", "of " + std::to_string(gnss_antenna.size()) + " values", "x, y and z, each in [-100, 100] m");
  require(tf_rate_hz >= 0.0 && tf_rate_hz <= MAX_TF_RATE_HZ, "tf_rate_hz", tf_rate_hz, "in [0, 4000]");
  require(mapping || map_file.empty(), "map_file", "\"" + map_file + "\"", "empty with mapping = false");
  require(!save_map || !map_file.empty(), "save_map", "true", "false without map_file");
  require(queue_size >= 1 && queue_size <= 1000, "queue_size", queue_size, "in [1, 1000]");
  require(imu_queue_size >= 1 && imu_queue_size <= 100000, "imu_queue_size", imu_queue_size, "in [1, 100000]");
  require(pair_tolerance_s >= 0.0 && pair_tolerance_s <= 0.1, "pair_tolerance_s", pair_tolerance_s, "in [0, 0.1]");
  require(pair_wait_s > pair_tolerance_s && pair_wait_s <= 2.0, "pair_wait_s", pair_wait_s,
          "above pair_tolerance_s, up to 2");
  require(imu_wait_s >= 0.0 && imu_wait_s <= 10.0, "imu_wait_s", imu_wait_s, "in [0, 10]");
  require(time_jump_s >= 0.01 && time_jump_s <= MAX_DURATION_S, "time_jump_s", time_jump_s, "in [0.01, 3600]");
  requireDuration("input_timeout_s", input_timeout_s);
  requireDuration("max_delay_s", max_delay_s);
  require(path_spacing_m >= 0.0 && path_spacing_m <= 100.0, "path_spacing_m", path_spacing_m, "in [0, 100]");
  require(path_length >= 2 && path_length <= 1000000, "path_length", path_length, "in [2, 1000000]");
  requireDuration("path_period_s", path_period_s);
  requireDuration("points_period_s", points_period_s);
  requireDuration("map_period_s", map_period_s);
  requireDuration("diagnostic_period", diagnostic_period);
  requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_slam

template struct pi_node::NodeParameters<pi_slam::VioRosOptions>;
