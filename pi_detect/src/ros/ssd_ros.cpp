#include "ros/ssd_ros.h"

#include <image_transport/camera_common.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/Track2DArray.h>
#include <pi_detect/model_catalogue.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_runtime/runtime.h>

#include <exception>
#include <opencv2/core/utility.hpp>
#include <utility>

#include "ros/packaged_models.h"

namespace pi_detect
{

namespace zero_copy = pi_os_transport::zero_copy;

namespace
{

std::shared_ptr<pi_runtime::Runtime> runtimeFor(const SsdRosOptions& options)
{
  const bool opencl = options.detector.target != Target::CPU;
  return options.use_runtime ? pi_runtime::Runtime::shared(pi_runtime::RuntimeOptions::forService(opencl)) : nullptr;
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
  , runtime_(runtimeFor(options_))
  , warnings_(options_.warning_period_s, pi_node::warningLog<SsdRosOptions>("ssd"))
  , diagnostics_(service_node_, private_node, &warnings_, options_.input_timeout_s)
  , turn_(input_node_, options_.tracker.odom_frame, image_transport::getCameraInfoTopic(topic_), isRectified(topic_))
  , worker_(options_, topic_, &warnings_, &diagnostics_, turn_, [this](const FoundObjects& found) { publish(found); })
  , input_transport_(input_node_)
  , overlay_transport_(service_node_)
  , vision_info_(service_node_, private_node)
{
  requireTransport(input_transport_, options_.image_transport, private_node.resolveName("image_transport"));
  asked_for_ = options_.model;
  worker_.beginLoading(asked_for_);

  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  detections_ = DetectionPublisher(service_node_, 2, look);
  tracks_ = service_node_.advertise<Track2DArray>("tracks", 2, look, look);
  labels_ = pi_node::LatchedPublisher<LabelArray>(service_node_, "labels", 1);
  const auto look_at_overlay = [this](const image_transport::SingleSubscriberPublisher&) { updateSubscription(); };
  overlay_ = overlay_transport_.advertise("overlay", 1, look_at_overlay, look_at_overlay);
  services_.push_back(service_node_.advertiseService("detect", &SsdRos::detect, this));
  services_.push_back(loader_node_.advertiseService("set_model", &SsdRos::setModel, this));
  timer_ = pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { publishDiagnostics(); });
  loader_thread_.post(
      [this]
      {
        std::string message;
        load(asked_for_, &message);
      });
  service_thread_.post([this] { updateSubscription(); });

  worker_.start();
  input_thread_.start();
  loader_thread_.start();
  service_thread_.start();
}

SsdRos::~SsdRos()
{
  worker_.stop();
  input_thread_.stop();
  service_thread_.stop();
  loader_thread_.stop();
  image_.shutdown();
  turn_.listen(false);
  services_.clear();
}

void SsdRos::publish(const FoundObjects& found)
{
  const std_msgs::Header header = zero_copy::standardHeader(found.picture->message().header);
  detections_.publish(toMsg(found.detections, header));
  tracks_.publish(toMsg(found.tracks, found.detector->model().labels, header));
  if (overlay_.getNumSubscribers() > 0 && !drawing_.exchange(true))
  {
    service_thread_.post([this, found] { publishOverlay(found); });
  }
}

// ---------------------------------------------------------------------------------------------------------- ssd_loader

bool SsdRos::load(const std::string& model, std::string* message)
{
  worker_.beginLoading(model);
  std::shared_ptr<Detector> detector;
  std::string notice;
  try
  {
    const ChosenModel chosen = chooseModel(model, packagedModels());
    notice = chosen.notice;
    detector = std::make_shared<Detector>(chosen.description, options_.detectorOptions(chosen.description), runtime_);
  }
  catch (const std::exception& error)
  {
    const auto kept = worker_.failLoading(error.what());
    *message = error.what() + (kept ? "; " + describe(*kept) + " stays in use"
                                    : "; no detection until set_model is called with a model that is right");
    ROS_ERROR_STREAM_NAMED("ssd", *message);
    return false;
  }
  *message = describe(*detector);
  ROS_INFO_STREAM_NAMED("ssd", "detects with " << *message << ", " << detector->model().labels.size() << " classes");
  if (!notice.empty())
  {
    *message += ": " + notice;
    ROS_WARN_STREAM_NAMED("ssd", notice);
  }
  const TargetInUse& target = detector->target();
  if (target.used != target.requested)
  {
    *message += std::string(", not on ") + toString(target.requested) + ": " + target.reason;
    ROS_WARN_STREAM_NAMED("ssd", *message);
  }
  LabelArray labels = toMsg(detector->model());
  labels.header.stamp = ros::Time::now();
  vision_info_.publish(detector->model());
  worker_.use(std::move(detector), notice);
  diagnostics_.reset();
  labels_.publish(labels);
  return true;
}

bool SsdRos::setModel(SetModel::Request& request, SetModel::Response& response)
{
  if (isModelPath(request.description) && request.description.front() != '/')
  {
    response.message = "description = \"" + request.description +
                       "\", must be the name of a network or an absolute path: the node's working folder is not the "
                       "caller's";
    return true;
  }
  if (!request.description.empty())
  {
    asked_for_ = request.description;
  }
  response.success = load(asked_for_, &response.message);
  return true;
}

// --------------------------------------------------------------------------------------------------------- ssd_service

bool SsdRos::detect(DetectObjects::Request& request, DetectObjects::Response& response)
{
  response.detections.header = request.image.header;
  // The request outlives the call.
  const sensor_msgs::ImageConstPtr image(&request.image, [](const sensor_msgs::Image*) {});
  return worker_.detect(zero_copy::toHandle(image), &response);
}

void SsdRos::updateSubscription()
{
  const bool followed = options_.always_on || tracks_.getNumSubscribers() > 0 || overlay_.getNumSubscribers() > 0;
  const bool wanted = followed || detections_.getNumSubscribers() > 0;
  worker_.follow(followed);
  turn_.listen(followed);
  if (wanted == subscribed_)
  {
    return;
  }
  subscribed_ = wanted;
  if (!wanted)
  {
    image_.shutdown();
    worker_.dropPicture();
    return;
  }
  worker_.awaitPictures();
  try
  {
    const image_transport::TransportHints hints(options_.image_transport, ros::TransportHints().tcpNoDelay(),
                                                private_node_);
    image_.subscribe(input_node_, input_transport_, "image", 1, options_.zero_copy, hints,
                     [this](const zero_copy::ImageHandle& message) { worker_.add(message); });
  }
  catch (const std::exception& error)
  {
    subscribed_ = false;
    warnings_.error(topic_ + ": " + error.what());
  }
}

void SsdRos::publishOverlay(const FoundObjects& found)
{
  try
  {
    overlay_.publish(
        toImage(drawOverlay(found, diagnostics_.rate()), zero_copy::standardHeader(found.picture->message().header)));
  }
  catch (const std::exception& error)
  {
    warnings_.warn(std::string("overlay: ") + error.what());
  }
  drawing_ = false;
}

void SsdRos::publishDiagnostics()
{
  updateSubscription();  // also when somebody left without saying so
  SsdFigures figures;
  worker_.report(&figures);
  figures.topic = topic_;
  figures.subscribed = subscribed_;
  figures.threads = cv::getNumThreads();
  if (figures.subscribed && figures.silent_s > options_.input_timeout_s)
  {
    warnings_.warn(topic_ + pi_node::format(": nothing for %.1f s", figures.silent_s) +
                   "; check that the camera runs and that the topic is its");
  }
  diagnostics_.update(figures);
}

}  // namespace pi_detect
