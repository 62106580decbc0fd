#pragma once

#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/ros/detection_publisher.h>
#include <pi_detect/ros/message_picture.h>
#include <pi_node/rate_limit.h>
#include <pi_node/ros/warning_board.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <ros/ros.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "client/offload_client.h"
#include "engine/local_queue.h"
#include "ros/answer_check.h"
#include "ros/coordinator_diagnostics.h"
#include "ros/coordinator_ros_options.h"
#include "ros/task_ledger.h"

namespace pi_offload
{

/// Makes a task of each picture on `image` and publishes the task's result on `detections`. Gives the vehicle's
/// pictures to its own detector, one at a time, and tells the engine how each run ended. The detector also gets some
/// pictures that nodes answered, while it has nothing else to do: AnswerCheck compares the answers.
class PictureTasks
{
public:
  /// Advertises `detections` and `local/image`, subscribes to `local/labels`.
  /// @param input_node    callbacks of pictures and of the detector's results.
  /// @param service_node  callbacks of subscribers that come and go.
  /// @param options, client, checks, ledger, warnings  outlive this object.
  PictureTasks(ros::NodeHandle input_node, ros::NodeHandle service_node, const CoordinatorRosOptions* options,
               OffloadClient* client, AnswerCheck* checks, TaskLedger* ledger, pi_node::WarningBoard* warnings);

  // On the service thread:

  /// Subscribes to pictures while somebody listens to the results.
  void updateSubscription();
  void fillInput(CoordinatorFigures* figures) const;

  // On the engine thread:

  void runLocal(const Task& task);
  void deliver(const Outcome& outcome, const OffloadReply* reply);
  /// When a result that waits for those of older pictures has waited long enough [ns]; INT64_MAX: none waits.
  int64_t nextTime() const;
  void onTime(int64_t now_ns);
  /// Gives up a picture that the detector did not answer for too long, and a check that could not begin. Nodes whose
  /// time out is over get tasks again.
  void tidy(int64_t now_ns);
  void fill(CoordinatorFigures* figures) const;

private:
  /// A picture whose task has not ended.
  struct Picture
  {
    std::shared_ptr<const pi_detect::MessagePicture> picture;
    pi_os_transport::zero_copy::ImageHandle message;
    uint64_t epoch = 0;  ///< how often stamps had gone back before
    int64_t deadline_ns = 0;
    pi_detect::Detection2DArrayConstPtr local;  ///< result of the vehicle's detector
  };

  /// A picture that a node answered and the vehicle's detector is to do as well.
  struct Check
  {
    uint64_t run = 0;  ///< at the engine; 0: it has not begun
    std::string node;
    std::string network;  ///< of the node
    pi_detect::Detection2DArrayConstPtr answered;
    pi_os_transport::zero_copy::ImageHandle message;
    int64_t since_ns = 0;
  };

  // Input thread:
  void onImage(const pi_os_transport::zero_copy::ImageHandle& message);
  void onLocalDetections(const pi_detect::Detection2DArrayConstPtr& message);
  void onLocalLabels(const pi_detect::LabelArrayConstPtr& message);

  // Engine thread:
  void submit(const std::shared_ptr<const pi_detect::MessagePicture>& picture,
              const pi_os_transport::zero_copy::ImageHandle& message, int64_t created_ns, int64_t now_ns);
  /// @return false: it is dropped, its deadline is over and a later one was published.
  bool publish(const Picture& picture, const pi_detect::Detection2DArrayConstPtr& result);
  void publishFirst();
  int64_t firstWaitsUntil() const;
  void onLocalResult(const pi_detect::Detection2DArrayConstPtr& message, int64_t now_ns);
  void giveNext(int64_t now_ns);
  void localFailed(uint64_t task, int64_t now_ns);
  void beginCheck(int64_t now_ns);
  void endCheck(const pi_detect::Detection2DArray& own, int64_t now_ns);

  ros::NodeHandle input_node_;
  const std::string topic_;
  const CoordinatorRosOptions* const options_;
  const double deadline_s_;
  OffloadClient* const client_;
  AnswerCheck* const checks_;
  TaskLedger* const ledger_;
  pi_node::WarningBoard* const warnings_;

  std::atomic<size_t> posted_{0};  ///< pictures on their way from the input to the engine thread
  std::atomic<uint64_t> came_{0};
  std::atomic<uint64_t> crowded_{0};
  std::atomic<int64_t> came_at_ns_{0};
  pi_node::RateLimit rate_limit_;  ///< of the input thread
  pi_detect::UsedBits used_bits_;  ///< likewise

  // Engine thread:
  std::map<uint64_t, Picture> pictures_;
  uint64_t epoch_ = 0;
  ros::Time submitted_stamp_;
  ros::Time published_stamp_;
  /// Results that wait for those of older pictures.
  std::multimap<ros::Time, pi_detect::Detection2DArrayConstPtr> ready_;
  uint64_t late_ = 0;
  LocalQueue local_queue_;
  double local_work_s_;                   ///< recent mean of the detector's time
  std::string local_model_;               ///< network of the vehicle's detector; empty: it has not said it
  std::map<std::string, int> class_ids_;  ///< of its classes, by their names
  const std::map<std::string, std::set<std::string>> networks_;  ///< classes of those that pi_detect knows, by name
  std::optional<Check> check_;

  bool subscribed_ = false;  ///< of the service thread
  pi_detect::DetectionPublisher detections_;
  ros::Subscriber image_;
  ros::Subscriber local_detections_;
  ros::Publisher local_image_;
  ros::Subscriber local_labels_;
};

}  // namespace pi_offload
