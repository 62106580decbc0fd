#include "ros/tracker_ros.h"
#include <pi_detect/Track2DArray.h>
#include <pi_node/ros/node_options.h>

#include <stdexcept>
#include <utility>

namespace pi_detect
{
namespace
{

constexpr uint32_t QUEUE = 20;

}  // namespace

TrackerRos::TrackerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("tracker")
  , node_(thread_.handle(std::move(node)))
  , options_(pi_node::loadNodeOptions<TrackerRosOptions>(private_node, "tracker"))
  , topic_(node_.resolveName("detections"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<TrackerRosOptions>("tracker"))
  , turn_(node_, options_.tracker.odom_frame, node_.resolveName("camera_info"), options_.rectified)
  , tracker_(options_.tracker.forNetwork(scores_))
{
  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  {
    std::lock_guard<std::mutex> lock(subscription_mutex_);
    tracks_ = node_.advertise<Track2DArray>("tracks", 2, look, look);
  }
  labels_input_ = node_.subscribe<LabelArray>("labels", 1, &TrackerRos::onLabels, this);
  thread_.post([this] { updateSubscription(); });
  thread_.start();
}

TrackerRos::~TrackerRos()
{
  thread_.stop();
}

void TrackerRos::updateSubscription()
{
  std::lock_guard<std::mutex> lock(subscription_mutex_);
  const bool wanted = options_.always_on || tracks_.getNumSubscribers() != 0;
  if (wanted && !detections_)
  {
    turn_.listen(true);
    detections_ = node_.subscribe<Detection2DArray>("detections", QUEUE, &TrackerRos::onDetections, this,
                                                    ros::TransportHints().tcpNoDelay());
  }
  else if (!wanted && detections_)
  {
    turn_.listen(false);
    detections_.shutdown();
    detections_ = ros::Subscriber();
  }
}

void TrackerRos::onLabels(const LabelArrayConstPtr& message)
{
  try
  {
    Labels labels = fromMsg(*message);
    const TrackerScores scores = scoresOf(*message);
    if (labels != labels_ || scores.high != scores_.high || scores.low != scores_.low)
    {
      tracker_.restart(options_.tracker.forNetwork(scores));  // ids of classes mean something else now
      labels_ = std::move(labels);
      scores_ = scores;
    }
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(node_.resolveName("labels") + ": " + error.what() + "; message ignored");
  }
}

void TrackerRos::onDetections(const Detection2DArrayConstPtr& message)
{
  if (message->header.stamp.isZero())
  {
    warnings_.warn(topic_ + ": stamp is 0, so nothing can be followed; whoever publishes it must stamp its messages");
    return;
  }
  TrackerView view;
  view.motion = turn_.between(last_followed_, message->header.stamp, message->header.frame_id);
  last_followed_ = message->header.stamp;
  const std::vector<ObjectTrack> tracks = tracker_.update(fromMsg(message->header.stamp), fromMsg(*message), view);
  tracks_.publish(toMsg(tracks, labels_, message->header));
}

}  // namespace pi_detect
