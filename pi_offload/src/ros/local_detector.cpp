#include "ros/local_detector.h"

#include <pi_detect/ros/conversions.h>
#include <pi_node/durations.h>

#include <utility>
#include <vector>

namespace pi_offload
{
namespace
{

constexpr double WORK_GAIN = 0.125;  ///< weight of the newest time

}  // namespace

LocalDetector::LocalDetector(ros::NodeHandle* input_node, ros::NodeHandle* service_node,
                             const CoordinatorRosOptions* options, OffloadClient* client, Callbacks callbacks)
  : options_(options)
  , client_(client)
  , callbacks_(std::move(callbacks))
  , queue_(options->max_local_waiting, options->local_lost_s)
  , work_s_(options->detection_local_s)
  , model_(options->local_model)
{
  client_->setModel(model_);
  const auto look = [this](const ros::SingleSubscriberPublisher&)
  { client_->post([this](int64_t now_ns) { giveNext(now_ns); }); };
  image_ = service_node->advertise<sensor_msgs::Image>("local/image", 2, look, look);
  labels_ =
      input_node->subscribe("local/labels", 1, &LocalDetector::onLabels, this, ros::TransportHints().tcpNoDelay());
}

void LocalDetector::onLabels(const pi_detect::LabelArrayConstPtr& message)
{
  if (!options_->local_model.empty())
  {
    return;
  }
  client_->post(
      [this, message](int64_t now_ns)
      {
        model_ = message->model;
        client_->setModel(model_);
        giveNext(now_ns);
      });
}

void LocalDetector::add(const LocalQueue::Entry& entry, int64_t now_ns)
{
  if (const auto dropped = queue_.add(entry))
  {
    client_->engine().onLocalFailed(dropped->task, now_ns);
  }
  giveNext(now_ns);
}

void LocalDetector::onResult(const Result& message, int64_t now_ns)
{
  const LocalQueue::Answer answer = queue_.answered(pi_detect::fromMsg(message->header.stamp), now_ns);
  if (!answer.expected)
  {
    return;
  }
  if (answer.skipped)
  {
    client_->engine().onLocalFailed(answer.task, now_ns);
  }
  else
  {
    work_s_ += WORK_GAIN * (answer.work_s - work_s_);
    callbacks_.result(answer.task, message);
    client_->engine().onLocalDone(answer.task, answer.work_s, now_ns);
  }
  giveNext(pi_node::monotonicNs());
}

/// Does nothing while the detector is not there; it is called again when the detector comes.
void LocalDetector::giveNext(int64_t now_ns)
{
  if (model_.empty() || image_.getNumSubscribers() == 0)
  {
    return;
  }
  std::vector<LocalQueue::Entry> dropped;
  if (const auto next = queue_.next(now_ns, work_s_, &dropped))
  {
    // The message that came, not a copy.
    const pi_os_transport::zero_copy::ImageHandle message = callbacks_.message(next->task);
    if (const sensor_msgs::ImageConstPtr standard = pi_os_transport::zero_copy::standardOf(message))
    {
      image_.publish(standard);
    }
    else
    {
      image_.publish(message);
    }
  }
  for (const LocalQueue::Entry& entry : dropped)
  {
    client_->engine().onLocalFailed(entry.task, now_ns);
  }
}

void LocalDetector::release(const Outcome& outcome)
{
  const int64_t now_ns = pi_node::monotonicNs();
  if (queue_.forget(outcome.task.id))
  {
    client_->engine().onLocalFailed(outcome.task.id, now_ns);
  }
  if (outcome.how == Outcome::How::ABANDONED && queue_.giveUp(outcome.task.id))
  {
    giveNext(now_ns);
  }
}

void LocalDetector::clear(int64_t now_ns)
{
  for (const LocalQueue::Entry& entry : queue_.clear())
  {
    client_->engine().onLocalFailed(entry.task, now_ns);
  }
}

void LocalDetector::dropUnanswered(int64_t now_ns)
{
  if (queue_.busy() || queue_.waiting() > 0)
  {
    giveNext(now_ns);
  }
}

void LocalDetector::fill(CoordinatorFigures* figures) const
{
  figures->waiting = queue_.waiting();
  figures->model = model_;
  figures->detector_listens = image_.getNumSubscribers() > 0;
}

}  // namespace pi_offload
