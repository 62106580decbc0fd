#include "ros/image_transports.h"

#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/Track2DArray.h>
#include <pi_detect/ros/conversions.h>
#include "ros/default_model.h"
#include "ros/ssd_ros.h"
#include <pi_node/ros/node_options.h>
#include <pi_runtime/runtime.h>
#include <pthread.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <map>
#include <opencv2/core/utility.hpp>
#include <stdexcept>
#include <utility>

namespace pi_detect
{
namespace
{

namespace zero_copy = pi_os_transport::zero_copy;

double secondsBetween(std::chrono::steady_clock::time_point from, std::chrono::steady_clock::time_point to)
{
  return std::chrono::duration<double>(to - from).count();
}

std::string describe(const SsdDetector& detector)
{
  const TargetInUse& target = detector.target();
  return detector.model().name + " on " + toString(target.used) +
         (target.device.empty() ? "" : " (" + target.device + ")");
}

}  // namespace

SsdRos::SsdRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : input_thread_("ssd_input")
  , loader_thread_("ssd_loader")
  , service_thread_("ssd_service")
  , input_node_(input_thread_.handle(node))
  , loader_node_(loader_thread_.handle(node))
  , service_node_(service_thread_.handle(node))
  , private_node_(private_node)
  , options_(pi_node::loadNodeOptions<SsdRosOptions>(private_node, "ssd"))
  , topic_(node.resolveName("image"))
  , runtime_(options_.use_runtime ? pi_runtime::Runtime::shared() : nullptr)
  , warnings_(options_.warning_period_s, pi_node::warningLog<SsdRosOptions>("ssd"))
  , diagnostics_(service_node_, private_node, &warnings_, options_.input_timeout_s)
  , tracker_(options_.tracker)
  , input_transport_(input_node_)
  , overlay_transport_(service_node_)
{
  requireTransport(input_transport_, options_.image_transport, private_node.resolveName("image_transport"));
  asked_for_ = options_.model.empty() ? defaultModel() : options_.model;
  loading_ = asked_for_;

  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  detections_ = service_node_.advertise<Detection2DArray>("detections", 2, look, look);
  tracks_ = service_node_.advertise<Track2DArray>("tracks", 2, look, look);
  labels_ = service_node_.advertise<LabelArray>("labels", 1, true);
  const auto look_at_overlay = [this](const image_transport::SingleSubscriberPublisher&) { updateSubscription(); };
  overlay_ = overlay_transport_.advertise("overlay", 1, look_at_overlay, look_at_overlay);
  services_.push_back(service_node_.advertiseService("detect", &SsdRos::detect, this));
  services_.push_back(loader_node_.advertiseService("set_model", &SsdRos::setModel, this));
  timer_ = service_node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                         [this](const ros::WallTimerEvent&) { publishDiagnostics(); });
  loader_thread_.post(
      [this]
      {
        std::string message;
        load(asked_for_, &message);
      });
  service_thread_.post([this] { updateSubscription(); });

  worker_ = std::thread([this] { work(); });
  input_thread_.start();
  loader_thread_.start();
  service_thread_.start();
}

SsdRos::~SsdRos()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  work_changed_.notify_all();
  worker_.join();
  input_thread_.stop();
  service_thread_.stop();
  loader_thread_.stop();
  image_.shutdown();
  services_.clear();
}

// ---------------------------------------------------------------------------------------------------------- ssd_input

void SsdRos::onImage(const zero_copy::ImageHandle& message)
{
  ++pictures_;
  const Clock::time_point now = Clock::now();
  came_at_ = now.time_since_epoch().count();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!detector_)
    {
      return;
    }
    if (!rate_limit_.take(now))
    {
      ++left_out_;
      return;
    }
    dropped_ += picture_ ? 1 : 0;
    picture_ = message;
  }
  work_changed_.notify_one();
}

// --------------------------------------------------------------------------------------------------------- ssd_worker

void SsdRos::work()
{
  pthread_setname_np(pthread_self(), "ssd_worker");
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    work_changed_.wait(lock, [this] { return stopping_ || !calls_.empty() || (picture_ && detector_); });
    if (stopping_)
    {
      worker_ended_ = true;
      call_done_.notify_all();
      return;
    }
    std::shared_ptr<SsdDetector> detector = detector_;
    if (!calls_.empty())
    {
      Call* const call = calls_.front();
      calls_.pop_front();
      lock.unlock();
      serve(*call, detector.get());
      detector.reset();
      lock.lock();
      call->done = true;
      call_done_.notify_all();
      continue;
    }
    const zero_copy::ImageHandle message = std::move(picture_);
    picture_.reset();
    lock.unlock();
    try
    {
      workOn(message, detector);
    }
    catch (const std::invalid_argument& error)
    {
      warnings_.error(topic_ + ": " + error.what() + "; picture ignored");
    }
    catch (const std::exception& error)
    {
      warnings_.error(std::string("detection failed: ") + error.what());
    }
    detector.reset();  // may be the last to hold an old one, whose end takes time
    lock.lock();
  }
}

void SsdRos::workOn(const zero_copy::ImageHandle& message, const std::shared_ptr<SsdDetector>& detector)
{
  const Clock::time_point begin = Clock::now();
  const auto picture = std::make_shared<const MessagePicture>(message);
  DetectionResult result = detector->detect(picture->view());
  const Labels& labels = detector->model().labels;
  if (worked_with_.lock() != detector)
  {
    tracker_.clear();  // ids of classes mean something else now
    worked_with_ = detector;
  }
  std::vector<ObjectTrack> tracks;
  if (message->header.stamp.isZero())
  {
    warnings_.warn(topic_ + ": stamp is 0, so nothing can be followed; the driver must stamp its messages");
  }
  else
  {
    tracks = tracker_.update(fromMsg(message->header.stamp), result.detections);
  }
  result.detections = wanted(result.detections, detector->model());
  const std_msgs::Header header = zero_copy::standardHeader(message->header);
  detections_.publish(toMsg(result.detections, header));
  tracks_.publish(toMsg(tracks, labels, header));
  diagnostics_.addPicture(result,
                          message->header.stamp.isZero() ? 0.0 : (ros::Time::now() - message->header.stamp).toSec(),
                          secondsBetween(begin, Clock::now()));
  if (overlay_.getNumSubscribers() > 0 && !drawing_.exchange(true))
  {
    service_thread_.post([this, overlay = Overlay{picture, result.detections, tracks, detector}]
                         { publishOverlay(overlay); });
  }
}

void SsdRos::serve(const Call& call, SsdDetector* detector)
{
  DetectObjects::Response& response = *call.response;
  try
  {
    const MessagePicture picture(call.image);
    const DetectionResult result = detector->detect(picture.view());
    response.detections =
        *toMsg(wanted(result.detections, detector->model()), zero_copy::standardHeader(call.image->header));
    response.success = true;
    response.message = describe(*detector);
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  ++calls_served_;
}

Detections SsdRos::wanted(const Detections& all, const ModelDescription& model) const
{
  const std::map<int, float> thresholds = options_.detector.filter.thresholds(model);
  Detections detections;
  std::copy_if(all.begin(), all.end(), std::back_inserter(detections),
               [&thresholds](const Detection& detection)
               {
                 const auto threshold = thresholds.find(detection.class_id);
                 return threshold != thresholds.end() && detection.score >= threshold->second;
               });
  return detections;
}

// --------------------------------------------------------------------------------------------------------- ssd_loader

bool SsdRos::load(const std::string& path, std::string* message)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    loading_ = path;
  }
  std::shared_ptr<SsdDetector> detector;
  std::string problem;
  try
  {
    const ModelDescription model = ModelDescription::load(path);
    detector = std::make_shared<SsdDetector>(model, options_.detectorOptions(model), runtime_);
  }
  catch (const std::exception& error)
  {
    problem = error.what();
  }
  if (!detector)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    *message = problem + (detector_ ? "; " + describe(*detector_) + " stays in use"
                                    : "; no detection until set_model is called with a model that is right");
    ROS_ERROR_STREAM_NAMED("ssd", *message);
    loading_.clear();
    problem_ = problem;
    return false;
  }
  *message = describe(*detector);
  ROS_INFO_STREAM_NAMED("ssd", "detects with " << *message << ", " << detector->model().labels.size() << " classes");
  const TargetInUse& target = detector->target();
  if (target.used != target.requested)
  {
    *message += std::string(", not on ") + toString(target.requested) + ": " + target.reason;
    ROS_WARN_STREAM_NAMED("ssd", *message);
  }
  LabelArray labels = toMsg(detector->model());
  labels.header.stamp = ros::Time::now();
  {
    std::lock_guard<std::mutex> lock(mutex_);
    detector_.swap(detector);  // the old one ends after the lock
    loading_.clear();
    problem_.clear();
  }
  diagnostics_.reset();
  labels_.publish(labels);
  return true;
}

bool SsdRos::setModel(SetModel::Request& request, SetModel::Response& response)
{
  if (!request.description.empty() && request.description.front() != '/')
  {
    response.message = "description = \"" + request.description +
                       "\", must be an absolute path: the node's working folder is not the caller's";
    return true;
  }
  if (!request.description.empty())
  {
    asked_for_ = request.description;
  }
  response.success = load(asked_for_, &response.message);
  return true;
}

}  // namespace pi_detect
