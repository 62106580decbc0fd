#pragma once

#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/ros/message_picture.h>
#include <pi_offload/Decide.h>
#include <pi_offload/EdgeNode.h>
#include <pi_offload/Nodes.h>
#include <pi_offload/RegisterNode.h>
#include <pi_offload/SetEta.h>
#include <pi_offload/SetPolicy.h>
#include <pi_offload/Statistics.h>
#include "engine/local_queue.h"
#include "client/offload_client.h"
#include "ros/coordinator_diagnostics.h"
#include "ros/coordinator_ros_options.h"
#include "ros/map_frame.h"
#include "ros/node_markers.h"
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <pi_node/rate_limit.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/recent_values.h>
#include <pi_node/ros/warning_board.h>
#include <pi_speech/RecognizeUtterance.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/BatteryState.h>
#include <std_srvs/SetBool.h>

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace pi_offload
{

/// Decides for each picture and utterance whether the vehicle or an edge-cloud node works on it, and gets it done.
///
/// Pictures come on `image`, results go out on `detections` (pi_detect/Detection2DArray): one message per picture. What
/// the vehicle does itself goes out on `local/image`, the very message that came, and comes back on `local/detections`;
/// `local/labels` says which network the vehicle has. The vehicle's detector gets one picture at a time; it must not
/// leave pictures out (its max_rate_hz must be 0). A picture that neither the vehicle nor a node works on (the detector
/// is not there, or drops it) gets no message. Subscribed only while somebody listens to `detections`.
///
/// Utterances come by the service `recognize_utterance` (pi_speech/RecognizeUtterance). Where the vehicle is to work on
/// it, the answer is handled=false at once. Each call ends by its deadline.
///
/// Position and speed come on `odometry`, the planned route on `route`, the battery on `battery`, nodes from a map
/// file, parameters, `edge_nodes` and ~register_node. SLAM is never offloaded.
///
/// Threads: `offload_input` takes pictures and the detector's results, `offload_engine` decides, sends and publishes,
/// `offload_encode` makes JPEGs, `offload_service` does all else; utterances have threads of their own. One more per
/// node holds the connection.
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
  /// A picture whose task has not ended.
  struct Picture
  {
    std::shared_ptr<const pi_detect::MessagePicture> picture;
    pi_os_transport::zero_copy::ImageHandle message;
    uint64_t epoch = 0;  ///< stamps went back so often before
    int64_t deadline_ns = 0;
    pi_detect::Detection2DArrayConstPtr local;  ///< result of the vehicle's detector
  };
  /// A call of recognize_utterance; done and response by calls_mutex_.
  struct Call
  {
    std_msgs::Header header;
    bool done = false;
    pi_speech::RecognizeUtterance::Response response;
  };

  // offload_input
  void onImage(const pi_os_transport::zero_copy::ImageHandle& message);
  void onLocalDetections(const pi_detect::Detection2DArrayConstPtr& message);
  void onLabels(const pi_detect::LabelArrayConstPtr& message);

  // offload_engine
  void submit(const std::shared_ptr<const pi_detect::MessagePicture>& picture,
              const pi_os_transport::zero_copy::ImageHandle& message, int64_t created_ns, int64_t now_ns);
  void runLocal(const Task& task);
  void giveToDetector(int64_t now_ns);
  void deliver(const Outcome& outcome, const OffloadReply* reply);
  void deliverPicture(const Outcome& outcome, const OffloadReply* reply);
  void deliverUtterance(const Outcome& outcome, const OffloadReply* reply);
  void publishDecision(const Outcome& outcome, const std_msgs::Header& header);
  void publish(const Picture& picture, const pi_detect::Detection2DArrayConstPtr& result);
  /// @param reply  null: the recogniser does it itself.
  void answer(uint64_t task, const OffloadReply* reply, const std::string& node);
  bool detectorReady() const;
  CoordinatorFigures figures(int64_t now_ns);

  // speech threads
  bool recognizeUtterance(pi_speech::RecognizeUtterance::Request& request,
                          pi_speech::RecognizeUtterance::Response& response);

  // offload_service
  void onOdometry(const nav_msgs::OdometryConstPtr& message);
  void onRoute(const nav_msgs::PathConstPtr& message);
  void onBattery(const sensor_msgs::BatteryStateConstPtr& message);
  void onEdgeNode(const EdgeNodeConstPtr& message);
  bool decide(Decide::Request& request, Decide::Response& response);
  bool nodes(Nodes::Request& request, Nodes::Response& response);
  bool registerNode(RegisterNode::Request& request, RegisterNode::Response& response);
  bool setPolicy(SetPolicy::Request& request, SetPolicy::Response& response);
  bool setEta(SetEta::Request& request, SetEta::Response& response);
  bool statistics(Statistics::Request& request, Statistics::Response& response);
  bool enable(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response);
  /// @param[out] problem  why it cannot be used. @return false: tf does not know its frame yet.
  bool addNode(const EdgeNode& message, std::string* problem);
  void updateSubscription();
  void watch();
  void publishMarkers();
  void publishDiagnostics();
  void say(const std::string& problem);  ///< if it is not empty

  void advertise();
  void subscribe();
  void loadNodes();

  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread service_thread_;
  ros::NodeHandle input_node_;
  ros::NodeHandle service_node_;
  ros::NodeHandle service_private_node_;
  const CoordinatorRosOptions options_;
  const std::string topic_;
  const std::string vehicle_name_;
  pi_node::WarningBoard warnings_;
  CoordinatorDiagnostics diagnostics_;
  MapFrame map_;
  NodeMarkers node_markers_;

  std::mutex calls_mutex_;
  std::condition_variable call_changed_;
  bool stopping_ = false;  ///< by calls_mutex_
  std::atomic<uint64_t> next_task_{1};
  std::atomic<int> calls_running_{0};
  std::atomic<size_t> pictures_posted_{0};  ///< and not submitted yet
  std::atomic<uint64_t> pictures_came_{0};
  std::atomic<uint64_t> pictures_crowded_{0};
  std::atomic<int64_t> came_at_ns_{0};
  pi_node::RateLimit rate_limit_{options_.max_rate_hz};  ///< of offload_input

  // offload_engine
  std::map<uint64_t, Picture> pictures_;
  std::map<uint64_t, std::shared_ptr<Call>> calls_;
  LocalQueue local_;
  double local_s_;  ///< that the detector needed of late
  std::string model_;
  uint64_t epoch_ = 0;
  ros::Time submitted_stamp_;
  ros::Time published_stamp_;
  uint64_t late_ = 0;
  std::array<pi_node::RecentValues, TASK_KINDS> response_s_;

  // offload_service
  bool subscribed_ = false;
  ros::Subscriber image_;
  ros::Subscriber local_detections_;
  VehicleState vehicle_;
  int64_t odometry_at_ns_ = 0;  ///< 0: none came
  bool eta_by_battery_ = true;
  std::optional<double> charge_;
  std::string policy_name_;
  PolicyOptions policy_;
  std::map<std::string, EdgeNode> waiting_nodes_;  ///< whose frame tf does not know yet

  std::vector<ros::Subscriber> subscribers_;
  ros::Publisher detections_;
  ros::Publisher local_image_;
  ros::Publisher decisions_;
  ros::Publisher markers_;
  std::vector<ros::ServiceServer> services_;
  ros::ServiceServer utterances_;
  std::vector<ros::WallTimer> timers_;
  std::unique_ptr<OffloadClient> client_;
  ros::CallbackQueue speech_queue_;
  std::unique_ptr<ros::AsyncSpinner> speech_threads_;
};

}  // namespace pi_offload
