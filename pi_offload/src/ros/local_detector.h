#pragma once

#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <ros/ros.h>

#include <cstdint>
#include <functional>
#include <string>

#include "client/offload_client.h"
#include "engine/local_queue.h"
#include "ros/coordinator_diagnostics.h"
#include "ros/coordinator_ros_options.h"

namespace pi_offload
{

/// Gives pictures to the vehicle's own detector, one at a time, and tells the engine how each run ended.
/// Methods are for the engine thread.
class LocalDetector
{
public:
  using Result = pi_detect::Detection2DArrayConstPtr;
  struct Callbacks
  {
    /// The message of a picture whose task has not ended.
    std::function<pi_os_transport::zero_copy::ImageHandle(uint64_t task)> message;
    /// The detector's result; the engine is told afterwards.
    std::function<void(uint64_t task, const Result& result)> result;
  };

  /// Advertises `local/image`, subscribes to `local/labels`. @param options, client  outlive this object.
  LocalDetector(ros::NodeHandle* input_node, ros::NodeHandle* service_node, const CoordinatorRosOptions* options,
                OffloadClient* client, Callbacks callbacks);

  void add(const LocalQueue::Entry& entry, int64_t now_ns);
  /// The detector published a result.
  void onResult(const Result& message, int64_t now_ns);
  /// The task has ended in another way.
  void release(const Outcome& outcome);
  /// Gives up all pictures.
  void clear(int64_t now_ns);
  /// Gives up a picture that the detector did not answer for too long.
  void dropUnanswered(int64_t now_ns);
  void fill(CoordinatorFigures* figures) const;

private:
  void onLabels(const pi_detect::LabelArrayConstPtr& message);  ///< on the input thread
  void giveNext(int64_t now_ns);

  const CoordinatorRosOptions* const options_;
  OffloadClient* const client_;
  const Callbacks callbacks_;
  LocalQueue queue_;
  double work_s_;  ///< recent mean of the detector's time
  std::string model_;
  ros::Publisher image_;
  ros::Subscriber labels_;
};

}  // namespace pi_offload
