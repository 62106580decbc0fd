#pragma once

#include <image_transport/image_transport.h>
#include <pi_node/input_topic.h>
#include <pi_node/rate_limit.h>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/vehicle_time.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>

#include <cstdint>
#include <string>
#include <vector>

#include "obstacles/occupancy_grid.h"
#include "ros/obstacles/obstacle_markers.h"
#include "ros/obstacles/obstacles_diagnostics.h"
#include "ros/obstacles/obstacles_ros_options.h"
#include "ros/obstacles/obstacles_worker.h"
#include "ros/picture_subscription.h"

namespace pi_detect
{

/// Obstacles from a stereo camera on the graph. Subscribes to inputs while somebody listens to an output.
///
/// Three threads beside that of tf: `obs_input` receives messages; `obs_worker` works on pairs and publishes
/// (ObstaclesWorker); `obs_output` watches subscribers and publishes diagnostics.
class ObstaclesRos
{
public:
  /// Advertises. @throws std::invalid_argument for wrong parameters.
  ObstaclesRos(ros::NodeHandle node, ros::NodeHandle private_node);
  ~ObstaclesRos();
  ObstaclesRos(const ObstaclesRos&) = delete;
  ObstaclesRos& operator=(const ObstaclesRos&) = delete;

private:
  struct Input : pi_node::InputTopic
  {
    bool used = false;
    bool required = true;
  };

  // obs_input
  /// Notes a message. @return false if its stamp is 0.
  bool accept(Input* input, const ros::Time& stamp);

  // obs_worker
  void publish(const ObstaclesWorker::Found& found);
  void updateGrid(const ObstaclesWorker::Found& found);

  // obs_output
  void updateSubscription();
  void subscribe();
  void subscribeCamera(Side side);
  void publishDiagnostics();

  pi_node::CallbackThread input_thread_;
  pi_node::CallbackThread output_thread_;
  ros::NodeHandle input_node_;
  ros::NodeHandle output_node_;
  ros::NodeHandle private_node_;
  const ObstaclesRosOptions options_;
  const StereoTopics topics_;
  pi_node::WarningBoard warnings_;
  ObstaclesDiagnostics diagnostics_;
  const std::shared_ptr<pi_runtime::Runtime> runtime_;  ///< null: not used
  const std::shared_ptr<StereoStages> stages_;
  pi_runtime::Stage grid_stage_;  ///< used on obs_worker
  ObstaclesWorker worker_;

  Input picture_inputs_[2];
  Input info_inputs_[2];
  Input disparity_input_;
  Input track_input_;

  ObstacleMarkers marker_maker_;  ///< these are used on obs_worker
  OccupancyGrid grid_;
  pi_node::RateLimit grid_rate_;
  bool subscribed_ = false;  ///< these are used on obs_output
  PictureSubscription images_[2];
  std::vector<ros::Subscriber> subscribers_;

  image_transport::ImageTransport transport_;
  ros::Publisher obstacles_;
  ros::Publisher markers_;
  ros::Publisher points_;
  ros::Publisher disparity_;
  ros::Publisher grid_publisher_;
  pi_node::VehicleTimer timer_;
};

}  // namespace pi_detect
