#pragma once

#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <pi_offload/Decide.h>
#include <pi_offload/SetPolicy.h>
#include <pi_offload/Statistics.h>
#include <ros/ros.h>
#include <std_srvs/SetBool.h>

#include <cstdint>
#include <string>
#include <vector>

#include "client/offload_client.h"
#include "ros/answer_check.h"
#include "ros/coordinator_diagnostics.h"
#include "ros/coordinator_ros_options.h"
#include "ros/map_frame.h"
#include "ros/node_markers.h"
#include "ros/node_sources.h"
#include "ros/picture_tasks.h"
#include "ros/task_ledger.h"
#include "ros/utterance_tasks.h"
#include "ros/vehicle_inputs.h"

namespace pi_offload
{

/// Decides for each picture and utterance whether the vehicle or an edge-cloud node does it, and sees that it is done.
///
/// Pictures come on `image`. Their results go out on `detections` (pi_detect/Detection2DArray), one message per
/// picture. A picture for the vehicle goes to its own detector: out on `local/image`, back on `local/detections`;
/// `local/labels` names the detector's network. The detector gets one picture at a time and must answer each (its
/// max_rate_hz must be 0). There is no message for a picture that nobody did, for example if the detector is missing.
/// `image` is subscribed only while somebody listens to `detections`.
///
/// Utterances come by the service `recognize_utterance` (pi_speech/RecognizeUtterance). The answer handled=false hands
/// an utterance back to the vehicle's recogniser. SLAM is never offloaded.
///
/// Threads: `offload_input` receives pictures and the detector's results; `offload_engine` decides, sends and
/// publishes; `offload_encode` makes JPEGs; `offload_service` does the rest. Each utterance and each connection to a
/// node has a thread of its own.
class CoordinatorRos
{
public:
  /// Advertises, and begins to connect. @throws std::invalid_argument for wrong parameters, std::runtime_error for a
  ///   map file that cannot be read.
  CoordinatorRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~CoordinatorRos();
  CoordinatorRos(const CoordinatorRos&) = delete;
  CoordinatorRos& operator=(const CoordinatorRos&) = delete;

private:
  OffloadClient::Callbacks clientCallbacks();
  void advertise();

  // On the engine thread:
  CoordinatorFigures figures(int64_t now_ns);
  void decideNow(TaskKind kind, const Decide::Request& request, Decide::Response* response, int64_t now_ns);

  // On the service thread:
  bool statistics(Statistics::Request& request, Statistics::Response& response);
  bool decide(Decide::Request& request, Decide::Response& response);
  bool setPolicy(SetPolicy::Request& request, SetPolicy::Response& response);
  bool enable(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response);
  void watch();
  void publishMarkers();
  void publishDiagnostics();
  void warnOfInput(const CoordinatorFigures& figures);

  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread service_thread_;
  ros::NodeHandle service_node_;
  ros::NodeHandle service_private_node_;
  const CoordinatorRosOptions options_;
  const std::string vehicle_name_;
  std::string policy_name_;
  PolicyOptions policy_;
  pi_node::WarningBoard warnings_;
  CoordinatorDiagnostics diagnostics_;
  MapFrame map_;
  NodeMarkers node_markers_;
  OffloadClient client_;
  TaskLedger ledger_;
  AnswerCheck checks_;  ///< of the engine thread
  NodeSources node_sources_;
  PictureTasks pictures_;
  UtteranceTasks utterances_;
  VehicleInputs vehicle_;
  ros::Publisher markers_;
  std::vector<ros::ServiceServer> services_;
  std::vector<ros::WallTimer> timers_;
};

}  // namespace pi_offload
