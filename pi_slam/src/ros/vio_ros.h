#pragma once

#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include <boost/signals2/connection.hpp>
#include <vector>

#include "ros/vio_calibrator.h"
#include "ros/vio_diagnostics.h"
#include "ros/vio_gnss.h"
#include "ros/vio_grid.h"
#include "ros/vio_initial_pose.h"
#include "ros/vio_inputs.h"
#include "ros/vio_outputs.h"
#include "ros/vio_ros_options.h"
#include "ros/vio_services.h"
#include "ros/vio_session.h"
#include "ros/vio_topics.h"
#include "ros/vio_worker.h"

namespace pi_slam
{

/// Visual-inertial odometry and mapping on the graph.
///
/// Five threads: `vio_imu` gets IMU samples and publishes a pose for each. `vio_input` gets pictures and pairs them.
/// `vio_worker` works on pairs. `vio_output` prepares the calibration and publishes what may be slow. `vio_service`
/// serves calls. The IMU's thread takes no lock that is held during work on pictures, or while a map is written. The
/// first three, and roscpp's thread that receives messages, stand above the streams of the runtime
/// (Runtime::raiseThread()).
///
/// Odometry starts when the calibration is complete. It starts again when the calibration changes, when time goes back,
/// and on ~reset.
class VioRos
{
public:
  /// Subscribes and advertises. @throws std::invalid_argument for wrong parameters, CalibrationError for files.
  VioRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~VioRos();
  VioRos(const VioRos&) = delete;
  VioRos& operator=(const VioRos&) = delete;

private:
  void watchInputs();
  void publishDiagnostics();

  pi_node::CallbackThread imu_thread_;
  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread output_thread_;
  pi_node::CallbackThread service_thread_;
  ros::NodeHandle output_node_;
  const VioRosOptions options_;
  const VioPipeline::RuntimePtr runtime_;  ///< null if nothing uses it
  pi_node::WarningBoard warnings_;
  VioDiagnostics diagnostics_;
  VioTopics topics_;
  VioSession session_;
  VioCalibrator calibrator_;
  VioOutputs outputs_;
  VioWorker worker_;
  VioInputs inputs_;
  VioServices services_;
  VioGrid grid_;
  VioGnss gnss_;
  VioInitialPose initial_pose_;
  std::vector<pi_node::VehicleTimer> timers_;
  boost::signals2::connection receiving_;  ///< on roscpp's thread that receives messages
};

}  // namespace pi_slam
