#include "ros/obstacles/obstacles_ros.h"

#include <nav_msgs/OccupancyGrid.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <exception>

#include "detector/stage_threads.h"
#include "ros/obstacles/grid_conversions.h"

namespace pi_detect
{
namespace
{

/// Relative name of a camera's topic.
std::string nameOf(Side side, const char* topic)
{
  return std::string(side == LEFT ? "left/" : "right/") + topic;
}

const char* pictureTopic(const ObstaclesRosOptions& options)
{
  return options.source == StereoSource::RAW ? "image_raw" : "image_rect";
}

StereoTopics topicsOf(const ros::NodeHandle& node, const ObstaclesRosOptions& options)
{
  StereoTopics topics;
  for (const Side side : {LEFT, RIGHT})
  {
    topics.pictures[side] = node.resolveName(nameOf(side, pictureTopic(options)));
    topics.infos[side] = node.resolveName(nameOf(side, "camera_info"));
  }
  topics.disparity = node.resolveName("disparity");
  return topics;
}

}  // namespace

ObstaclesRos::ObstaclesRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : input_thread_("obs_input")
  , output_thread_("obs_output")
  , input_node_(input_thread_.handle(node))
  , output_node_(output_thread_.handle(node))
  , private_node_(private_node)
  , options_(pi_node::loadNodeOptions<ObstaclesRosOptions>(private_node, "obstacles"))
  , topics_(topicsOf(node, options_))
  , warnings_(options_.warning_period_s, pi_node::warningLog<ObstaclesRosOptions>("obstacles"))
  , diagnostics_(output_node_, private_node, &warnings_, options_.input_timeout_s, options_.min_coverage)
  , runtime_(options_.use_runtime ? pi_runtime::Runtime::shared(pi_runtime::RuntimeOptions::forService()) : nullptr)
  , stages_(std::make_shared<StereoStages>(runtime_))
  , grid_stage_(runtime_, {"obstacles_grid"})
  , worker_(node, options_, topics_, stages_, &warnings_, &diagnostics_,
            [this](const ObstaclesWorker::Found& found) { publish(found); })
  , marker_maker_(options_.marker_lifetime_s)
  , grid_(options_.grid)
  , grid_rate_(options_.grid.rate_hz)
  , transport_(input_node_)
{
  requireTransport(transport_, options_.image_transport, private_node.resolveName("image_transport"));
  if (runtime_)
  {
    cutStages(*runtime_, 0);
  }
  const bool pictures = options_.source != StereoSource::DISPARITY;
  for (const Side side : {LEFT, RIGHT})
  {
    picture_inputs_[side].topic = topics_.pictures[side];
    picture_inputs_[side].used = pictures;
    info_inputs_[side].topic = topics_.infos[side];
    info_inputs_[side].used = pictures || side == LEFT;
  }
  disparity_input_.topic = topics_.disparity;
  disparity_input_.used = !pictures;
  track_input_.topic = node.resolveName("tracks");
  track_input_.used = true;
  track_input_.required = false;

  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  obstacles_ = output_node_.advertise<ObstacleArray>("obstacles", 2, look, look);
  markers_ = output_node_.advertise<visualization_msgs::MarkerArray>("markers", 2, look, look);
  points_ = output_node_.advertise<sensor_msgs::PointCloud2>("obstacle_points", 2, look, look);
  disparity_ = output_node_.advertise<stereo_msgs::DisparityImage>("disparity_image", 1, look, look);
  grid_publisher_ = output_node_.advertise<nav_msgs::OccupancyGrid>("grid", 1, look, look);
  timer_ = pi_node::VehicleTimer(output_node_, options_.diagnostic_period, [this] { publishDiagnostics(); });
  output_thread_.post([this] { updateSubscription(); });

  worker_.start();
  input_thread_.start();
  output_thread_.start();
}

ObstaclesRos::~ObstaclesRos()
{
  worker_.stop();
  input_thread_.stop();
  output_thread_.stop();
  images_[LEFT].shutdown();
  images_[RIGHT].shutdown();
  subscribers_.clear();
}

bool ObstaclesRos::accept(Input* input, const ros::Time& stamp)
{
  input->note();
  if (stamp.isZero())
  {
    warnings_.error(input->topic + ": stamp is 0, message ignored; the driver must stamp its messages");
    return false;
  }
  return true;
}

void ObstaclesRos::publish(const ObstaclesWorker::Found& found)
{
  std_msgs::Header header;
  header.stamp = found.job.header().stamp;
  header.frame_id = options_.base_link_frame;
  const ObstacleArrayPtr message = toMsg(found.obstacles, found.labels, header);
  obstacles_.publish(message);
  markers_.publish(marker_maker_.update(*message));
  updateGrid(found);
  if (points_.getNumSubscribers() > 0)
  {
    points_.publish(toPointCloud(found.result.points, header));
  }
  if (disparity_.getNumSubscribers() > 0)
  {
    disparity_.publish(toDisparityImage(found.finder.disparity(), found.finder.geometry(), found.finder.minDepth(),
                                        found.job.header()));
  }
}

void ObstaclesRos::updateGrid(const ObstaclesWorker::Found& found)
{
  if (!found.vehicle)
  {
    grid_.clear();  // without its motion, nothing says how cells stay where they are
    return;
  }
  std::vector<Outline> left_out;
  for (const Obstacle& obstacle : found.obstacles)
  {
    const auto label = found.labels.find(obstacle.class_id);
    const std::string name = label == found.labels.end() ? std::string() : label->second;
    const auto& names = options_.grid_leaves_out;
    if (!obstacle.outline.empty() && (obstacle.moving || std::find(names.begin(), names.end(), name) != names.end()))
    {
      left_out.push_back(obstacle.outline);
    }
  }
  const pi_node::Footprint& o = options_.tracker.footprint;
  const Outline vehicle = {
      {-o.rear, -o.half_width}, {o.front, -o.half_width}, {o.front, o.half_width}, {-o.rear, o.half_width}};
  const ros::Time stamp = found.job.header().stamp;
  grid_stage_.run([&] { grid_.add(fromMsg(stamp), found.vehicle->T_odom_base, found.result.view, left_out, vehicle); });
  if (grid_rate_.take(fromMsg(stamp)) && grid_publisher_.getNumSubscribers() > 0)
  {
    std_msgs::Header header;
    header.stamp = stamp;
    header.frame_id = options_.odom_frame;
    grid_publisher_.publish(
        toMsg(grid_, found.vehicle->T_odom_base.translation().z() + options_.stereo.ground_z_m, header));
  }
}

// ---------------------------------------------------------------------------------------------------------- obs_output

void ObstaclesRos::updateSubscription()
{
  const bool wanted = options_.always_on || obstacles_.getNumSubscribers() > 0 || markers_.getNumSubscribers() > 0 ||
                      points_.getNumSubscribers() > 0 || disparity_.getNumSubscribers() > 0 ||
                      grid_publisher_.getNumSubscribers() > 0;
  if (wanted == subscribed_)
  {
    return;
  }
  subscribed_ = wanted;
  if (wanted)
  {
    worker_.take(true);
    subscribe();
    return;
  }
  images_[LEFT].shutdown();
  images_[RIGHT].shutdown();
  subscribers_.clear();
  worker_.take(false);
}

void ObstaclesRos::subscribe()
{
  const auto no_delay = ros::TransportHints().tcpNoDelay();
  try
  {
    subscribeCamera(LEFT);
    subscribeCamera(RIGHT);
    if (disparity_input_.used)
    {
      disparity_input_.restart();
      subscribers_.push_back(input_node_.subscribe<stereo_msgs::DisparityImage>(
          "disparity", 1,
          [this](const stereo_msgs::DisparityImageConstPtr& message)
          {
            if (accept(&disparity_input_, message->header.stamp))
            {
              worker_.add(message);
            }
          },
          ros::VoidConstPtr(), no_delay));
    }
    track_input_.restart();
    subscribers_.push_back(input_node_.subscribe<Track2DArray>(
        "tracks", 5,
        [this](const Track2DArrayConstPtr& message)
        {
          track_input_.note();
          worker_.add(message);
        },
        ros::VoidConstPtr(), no_delay));
  }
  catch (const std::exception& error)
  {
    warnings_.error(std::string("inputs cannot be subscribed: ") + error.what());
  }
}

void ObstaclesRos::subscribeCamera(Side side)
{
  const auto no_delay = ros::TransportHints().tcpNoDelay();
  if (picture_inputs_[side].used)
  {
    picture_inputs_[side].restart();
    const image_transport::TransportHints hints(options_.image_transport, no_delay, private_node_);
    images_[side].subscribe(input_node_, transport_, nameOf(side, pictureTopic(options_)), 2, options_.zero_copy, hints,
                            [this, side](const PictureSubscription::ImageHandle& message)
                            {
                              if (accept(&picture_inputs_[side], message->header.stamp))
                              {
                                worker_.add(side, message);
                              }
                            });
  }
  if (info_inputs_[side].used)
  {
    info_inputs_[side].restart();
    subscribers_.push_back(input_node_.subscribe<sensor_msgs::CameraInfo>(
        nameOf(side, "camera_info"), 2,
        [this, side](const sensor_msgs::CameraInfoConstPtr& info)
        {
          info_inputs_[side].note();
          worker_.add(side, info);
        },
        ros::VoidConstPtr(), no_delay));
  }
}

void ObstaclesRos::publishDiagnostics()
{
  updateSubscription();  // also when somebody left without saying so
  ObstaclesFigures figures;
  worker_.report(&figures);
  figures.subscribed = subscribed_;
  figures.stages = {{"obstacles_match", stages_->match.status().text()},
                    {"obstacles_find", stages_->find.status().text()},
                    {"obstacles_grid", grid_stage_.status().text()}};
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
      warnings_.warn(input->topic + pi_node::format(": nothing for %.1f s", figures.inputs.back().silent_s) +
                     "; check that its driver runs and that the topic is its");
    }
  }
  diagnostics_.update(figures);
}

}  // namespace pi_detect
