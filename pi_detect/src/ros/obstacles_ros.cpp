// The threads obs_input and obs_output of ObstaclesRos.

#include "ros/image_transports.h"

#include <pi_detect/ObstacleArray.h>
#include "ros/obstacles_ros.h"
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <exception>
#include <utility>

namespace pi_detect
{
namespace
{

using pi_node::format;

constexpr size_t KEPT_TRACKS = 30;

}  // namespace

void ObstaclesRos::Input::note()
{
  ++messages;
  restart();
}

void ObstaclesRos::Input::restart()
{
  came_at = Clock::now().time_since_epoch().count();
}

double ObstaclesRos::Input::silentSeconds() const
{
  return std::chrono::duration<double>(Clock::now().time_since_epoch() - Clock::duration(came_at)).count();
}

ObstaclesRos::ObstaclesRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : input_thread_("obs_input")
  , output_thread_("obs_output")
  , input_node_(input_thread_.handle(node))
  , output_node_(output_thread_.handle(node))
  , private_node_(private_node)
  , options_(pi_node::loadNodeOptions<ObstaclesRosOptions>(private_node, "obstacles"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<ObstaclesRosOptions>("obstacles"))
  , diagnostics_(output_node_, private_node, &warnings_, options_.input_timeout_s, options_.min_coverage)
  , motion_(node, options_.odom_frame, options_.base_link_frame, options_.tf_wait_s)
  , pairing_(options_.pair_tolerance_s)
  , tracker_(options_.tracker)
  , marker_maker_(options_.marker_lifetime_s)
  , transport_(input_node_)
{
  requireTransport(transport_, options_.image_transport, private_node.resolveName("image_transport"));
  const bool pictures = options_.source != StereoSource::DISPARITY;
  const std::string picture = options_.source == StereoSource::RAW ? "/image_raw" : "/image_rect";
  for (const Side side : {LEFT, RIGHT})
  {
    const std::string name = side == LEFT ? "left" : "right";
    picture_inputs_[side].topic = node.resolveName(name + picture);
    picture_inputs_[side].used = pictures;
    info_inputs_[side].topic = node.resolveName(name + "/camera_info");
    info_inputs_[side].used = pictures || side == LEFT;
  }
  disparity_input_.topic = node.resolveName("disparity");
  disparity_input_.used = !pictures;
  track_input_.topic = node.resolveName("tracks");
  track_input_.used = true;
  track_input_.required = false;

  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  obstacles_ = output_node_.advertise<ObstacleArray>("obstacles", 2, look, look);
  markers_ = output_node_.advertise<visualization_msgs::MarkerArray>("markers", 2, look, look);
  points_ = output_node_.advertise<sensor_msgs::PointCloud2>("points", 2, look, look);
  disparity_ = output_node_.advertise<stereo_msgs::DisparityImage>("disparity_image", 1, look, look);
  timer_ = output_node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                        [this](const ros::WallTimerEvent&) { publishDiagnostics(); });
  output_thread_.post([this] { updateSubscription(); });

  worker_ = std::thread([this] { work(); });
  input_thread_.start();
  output_thread_.start();
}

ObstaclesRos::~ObstaclesRos()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  motion_.stop();
  job_changed_.notify_all();
  worker_.join();
  input_thread_.stop();
  output_thread_.stop();
  images_[LEFT].shutdown();
  images_[RIGHT].shutdown();
  subscribers_.clear();
}

// ---------------------------------------------------------------------------------------------------------- obs_input

bool ObstaclesRos::isStamped(const Input& input, const ros::Time& stamp)
{
  if (stamp.isZero())
  {
    warnings_.error(input.topic + ": stamp is 0, message ignored; the driver must stamp its messages");
    return false;
  }
  return true;
}

void ObstaclesRos::onImage(Side side, const pi_os_transport::zero_copy::ImageHandle& message)
{
  picture_inputs_[side].note();
  if (!isStamped(picture_inputs_[side], message->header.stamp))
  {
    return;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  if (std::optional<StereoPair> pair = pairing_.add(side == RIGHT, message))
  {
    Job job;
    job.pair = std::move(*pair);
    offer(std::move(job));
  }
}

void ObstaclesRos::onDisparity(const stereo_msgs::DisparityImageConstPtr& message)
{
  disparity_input_.note();
  if (!isStamped(disparity_input_, message->header.stamp))
  {
    return;
  }
  Job job;
  job.disparity = message;
  std::lock_guard<std::mutex> lock(mutex_);
  offer(std::move(job));
}

void ObstaclesRos::offer(Job job)
{
  if (!rate_limit_.take(Clock::now()))
  {
    ++left_out_;
    return;
  }
  dropped_ += job_ ? 1 : 0;
  job_ = std::move(job);
  job_changed_.notify_one();
}

void ObstaclesRos::onTracks(const Track2DArrayConstPtr& message)
{
  track_input_.note();
  std::lock_guard<std::mutex> lock(mutex_);
  if (!recent_tracks_.empty() && message->header.stamp < recent_tracks_.back()->header.stamp)
  {
    recent_tracks_.clear();  // time began anew
  }
  recent_tracks_.push_back(message);
  if (recent_tracks_.size() > KEPT_TRACKS)
  {
    recent_tracks_.pop_front();
  }
}

// --------------------------------------------------------------------------------------------------------- obs_output

void ObstaclesRos::updateSubscription()
{
  const bool wanted = options_.always_on || obstacles_.getNumSubscribers() > 0 || markers_.getNumSubscribers() > 0 ||
                      points_.getNumSubscribers() > 0 || disparity_.getNumSubscribers() > 0;
  if (wanted == subscribed_)
  {
    return;
  }
  subscribed_ = wanted;
  if (wanted)
  {
    subscribe();
    return;
  }
  images_[LEFT].shutdown();
  images_[RIGHT].shutdown();
  subscribers_.clear();
  std::lock_guard<std::mutex> lock(mutex_);
  pairing_.clear();
  job_.reset();
  recent_tracks_.clear();
}

void ObstaclesRos::subscribe()
{
  const auto no_delay = ros::TransportHints().tcpNoDelay();
  try
  {
    for (const Side side : {LEFT, RIGHT})
    {
      const std::string name = side == LEFT ? "left" : "right";
      if (picture_inputs_[side].used)
      {
        picture_inputs_[side].restart();
        const image_transport::TransportHints hints(options_.image_transport, no_delay, private_node_);
        images_[side].subscribe(
            input_node_, transport_, name + (options_.source == StereoSource::RAW ? "/image_raw" : "/image_rect"), 2,
            options_.zero_copy, hints,
            [this, side](const PictureSubscription::ImageHandle& message) { onImage(side, message); });
      }
      if (info_inputs_[side].used)
      {
        info_inputs_[side].restart();
        subscribers_.push_back(input_node_.subscribe<sensor_msgs::CameraInfo>(
            name + "/camera_info", 2,
            [this, side](const sensor_msgs::CameraInfoConstPtr& info)
            {
              info_inputs_[side].note();
              std::lock_guard<std::mutex> lock(mutex_);
              infos_[side] = info;
            },
            ros::VoidConstPtr(), no_delay));
      }
    }
    if (disparity_input_.used)
    {
      disparity_input_.restart();
      subscribers_.push_back(input_node_.subscribe("disparity", 1, &ObstaclesRos::onDisparity, this, no_delay));
    }
    track_input_.restart();
    subscribers_.push_back(input_node_.subscribe("tracks", 5, &ObstaclesRos::onTracks, this, no_delay));
  }
  catch (const std::exception& error)
  {
    warnings_.error(std::string("inputs cannot be subscribed: ") + error.what());
  }
}

void ObstaclesRos::publishDiagnostics()
{
  updateSubscription();  // also when somebody left without saying so
  ObstaclesFigures figures;
  figures.subscribed = subscribed_;
  for (const Input* input : {&picture_inputs_[LEFT], &picture_inputs_[RIGHT], &info_inputs_[LEFT], &info_inputs_[RIGHT],
                             &disparity_input_, &track_input_})
  {
    if (!input->used)
    {
      continue;
    }
    figures.inputs.push_back({input->topic, input->messages, input->silentSeconds(), input->required});
    if (subscribed_ && input->required && figures.inputs.back().silent_s > options_.input_timeout_s)
    {
      warnings_.warn(input->topic + format(": nothing for %.1f s", figures.inputs.back().silent_s) +
                     "; check that its driver runs and that the topic is its");
    }
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    figures.dropped = dropped_;
    figures.left_out = left_out_;
    figures.single = pairing_.single();
    figures.problem = problem_;
    figures.failed = problem_failed_;
    figures.motion_problem = motion_problem_;
    figures.motion_known = motion_known_;
  }
  diagnostics_.update(figures);
}

}  // namespace pi_detect
