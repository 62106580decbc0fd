#pragma once

#include "renderer/stereo_renderer.h"
#include "ros/vehicle_simulator_ros_options.h"
#include "vehicle/vehicle_simulation.h"

#include <diagnostic_updater/diagnostic_updater.h>
#include <pi_node/ros/recent_values.h>
#include <pi_os_transport/zero_copy/publisher.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

namespace pi_simulation
{

/// Renders exposures on a thread of low priority, `rendering`, and publishes `left/` and `right/image_raw` and
/// `camera_info`. An exposure that still waits when the next one comes is skipped and counted. All methods from any
/// thread.
class SimulatedCameras
{
public:
  SimulatedCameras(ros::NodeHandle node, const VehicleSimulatorRosOptions& options,
                   const pi_slam::StereoCalibration& calibration);
  ~SimulatedCameras();
  SimulatedCameras(const SimulatedCameras&) = delete;
  SimulatedCameras& operator=(const SimulatedCameras&) = delete;

  /// Call once, when the world is built. @param done  called for each exposure that is published or that both
  /// cameras, being off, leave out; on the thread.
  void start(std::shared_ptr<const SyntheticWorld> world, const StereoRendererOptions& pictures,
             std::function<void(int64_t stamp_ns)> done);
  void request(const Exposure& exposure);
  void report(diagnostic_updater::DiagnosticStatusWrapper& status);

private:
  void renderLoop(const std::shared_ptr<const SyntheticWorld>& world, const StereoRendererOptions& pictures);
  void render(const Exposure& exposure, StereoRenderer* renderer);

  const VehicleSimulatorRosOptions& options_;
  const pi_slam::StereoCalibration& calibration_;
  pi_os_transport::zero_copy::Publisher<sensor_msgs::Image> left_;
  pi_os_transport::zero_copy::Publisher<sensor_msgs::Image> right_;
  ros::Publisher left_info_;
  ros::Publisher right_info_;

  std::function<void(int64_t)> done_;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;  ///< under mutex_, as all below
  std::optional<Exposure> waiting_;
  uint64_t pairs_ = 0;
  uint64_t skipped_ = 0;
  uint64_t skipped_before_ = 0;  ///< at the diagnostics before
  uint64_t pairs_before_ = 0;
  pi_node::RecentValues processor_ms_{200};
  pi_node::RecentValues delay_ms_{200};

  std::thread thread_;
};

}  // namespace pi_simulation
