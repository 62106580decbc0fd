#include "ros/sensors/stereo_camera_ros.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/vehicle_clock.h>

#include <cmath>
#include <utility>

namespace pi_vehicle
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;
using pi_node::sizeText;

namespace
{

constexpr double LEAST_OF_RATE = 0.9;  ///< of what the device promises

}  // namespace

StereoCameraRos::StereoCameraRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("camera_ros")
  , node_(thread_.handle(node))
  , options_(pi_node::loadNodeOptions<StereoCameraRosOptions>(private_node, "stereo_camera"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<StereoCameraRosOptions>("stereo_camera"))
  , updater_(node_, private_node, private_node.getNamespace())
  , pictures_(node_, options_, &warnings_)
  , pairs_(pi_node::nanoseconds(options_.max_time_difference_s))
{
  updater_.setHardwareID(options_.video.device);
  updater_.add("camera", [this](Status& status) { report(status); });
  before_ns_ = pi_node::vehicleNs();
  devices_.resize(options_.isSideBySide() ? 1 : 2);
  for (size_t device = 0; device < devices_.size(); ++device)
  {
    devices_[device].path = device == 0 ? options_.video.device : options_.right_device;
  }
  for (size_t device = 0; device < devices_.size(); ++device)
  {
    startReader(device);
  }
  timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
}

StereoCameraRos::~StereoCameraRos()
{
  thread_.stop();
  readers_.clear();
}

// ------------------------------------------------------------------------------------------------------------- camera

void StereoCameraRos::startReader(size_t device)
{
  VideoOptions video = options_.video;
  video.device = devices_[device].path;
  VideoEvents events;
  events.picture = [this, device](VideoPicture picture)
  {
    try
    {
      onPicture(device, std::move(picture));
    }
    catch (const std::exception& error)  // OpenCV's of a picture that it cannot convert
    {
      warnings_.error(devices_[device].path + ": a picture was left out: " + error.what());
    }
  };
  events.opened = [this, device](const VideoSource& source) { onOpened(device, source); };
  events.closed = [this, device](const std::string& problem, bool error) { onClosed(device, problem, error); };
  readers_.push_back(std::make_unique<VideoReader>(video, options_.reconnect_pause_s, std::move(events)));
}

void StereoCameraRos::onOpened(size_t device, const VideoSource& source)
{
  const std::string text = source.text();
  ROS_INFO_STREAM_NAMED("stereo_camera", text);
  if (!source.asAsked())
  {
    ROS_WARN_STREAM_NAMED("stereo_camera", text << ", but asked were "
                                                << sizeText(options_.video.width, options_.video.height) << " "
                                                << options_.video.pixel_format << ", " << options_.video.frame_rate
                                                << " Hz; v4l2-ctl --list-formats-ext shows what it can do");
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  Device& opened = devices_[device];
  opened.text = text;
  opened.problem.clear();
  opened.is_lost = false;
  opened.frame_rate = source.frameRate();
  ++opened.opened;
}

void StereoCameraRos::onClosed(size_t device, const std::string& problem, bool error)
{
  if (error)
  {
    ROS_ERROR_STREAM_NAMED("stereo_camera", problem << "; tried again until it is there");
  }
  else
  {
    ROS_INFO_STREAM_NAMED("stereo_camera", problem << "; it begins again");
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  devices_[device].problem = problem;
  devices_[device].is_lost = error;
}

void StereoCameraRos::onPicture(size_t device, VideoPicture picture)
{
  const std::lock_guard<std::mutex> lock(pictures_mutex_);
  const std::string& path = devices_[device].path;
  if (!picture.by_driver)
  {
    count(&Figures::by_arrival);
    warnings_.warn(path +
                   ": the driver's times are not credible; pictures have the time of their arrival, which is "
                   "late; try another USB port or kernel");
  }
  const cv::Mat both = picture.picture;
  if (both.empty())
  {
    count(&Figures::undecodable);
  }
  else if (!options_.isSideBySide())
  {
    if (const auto pair = pairs_.add(device, std::move(picture)))
    {
      publish(pair->first, pair->second);
    }
    const std::lock_guard<std::mutex> figures_lock(mutex_);
    figures_.unpaired = pairs_.dropped();
    difference_ns_ = pairs_.difference();
  }
  else if (both.cols % 2 != 0)
  {
    count(&Figures::unusable);
    warnings_.error(path + ": a picture of " + sizeText(both.cols, both.rows) +
                    " cannot be halved; give a width that is even, or right_device for two cameras");
  }
  else
  {
    VideoPicture right = picture;
    picture.picture = both.colRange(0, both.cols / 2);
    right.picture = both.colRange(both.cols / 2, both.cols);
    publish(picture, right);
  }
}

void StereoCameraRos::publish(const VideoPicture& left, const VideoPicture& right)
{
  if (left.picture.size() != right.picture.size())
  {
    count(&Figures::unusable);
    warnings_.error("left pictures are " + sizeText(left.picture.cols, left.picture.rows) + ", right ones " +
                    sizeText(right.picture.cols, right.picture.rows) + "; use two cameras of one kind");
    return;
  }
  const ros::Time stamp = pictures_.publish(left, right);
  count(&Figures::pairs);
  const std::lock_guard<std::mutex> lock(mutex_);
  difference_ms_.add(1e3 * std::abs(pi_node::secondsBetween(left.stamp_ns, right.stamp_ns)));
  delay_ms_.add(1e3 * (ros::Time::now() - stamp).toSec());
}

void StereoCameraRos::count(uint64_t Figures::*figure)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  ++(figures_.*figure);
}

// --------------------------------------------------------------------------------------------------------- camera_ros

void StereoCameraRos::report(Status& status)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  const int64_t now_ns = pi_node::vehicleNs();
  Figures lately = figures_;
  lately.pairs -= before_.pairs;
  lately.undecodable -= before_.undecodable;
  lately.unusable -= before_.unusable;
  lately.unpaired -= before_.unpaired;
  const double rate = static_cast<double>(lately.pairs) / pi_node::secondsBetween(before_ns_, now_ns);
  before_ = figures_;
  before_ns_ = now_ns;
  summarize(lately, rate, &status);
  for (const Device& device : devices_)
  {
    status.add(device.path, device.problem.empty() ? device.text : device.problem);
    status.add(device.path + ", times opened", device.opened);
  }
  status.add("pairs", figures_.pairs);
  status.add("pairs per second", format("%.1f", rate));
  status.add("pictures without a partner", figures_.unpaired);
  status.add("pictures that cannot be decoded", figures_.undecodable);
  status.add("pictures or pairs of a wrong size", figures_.unusable);
  status.add("pictures with the time of their arrival", figures_.by_arrival);
  status.add("time difference p50 [ms]", format("%.3f", difference_ms_.quantile(0.5)));
  status.add("time difference p99 [ms]", format("%.3f", difference_ms_.quantile(0.99)));
  status.add("delay of pictures p50 [ms]", format("%.1f", delay_ms_.quantile(0.5)));
  status.add("delay of pictures p99 [ms]", format("%.1f", delay_ms_.quantile(0.99)));
  pi_node::addWarnings(warnings_.recent(), &status);
}

void StereoCameraRos::summarize(const Figures& lately, double rate, Status* status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  for (const Device& device : devices_)
  {
    if (!device.problem.empty())
    {
      status->summary(device.is_lost ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, device.problem);
      return;
    }
  }
  const double expected = devices_.front().frame_rate;
  if (lately.unpaired > lately.pairs)
  {
    status->summary(DiagnosticStatus::ERROR,
                    format("left and right are %.1f ms apart, at most %.1f ms pass; trigger the cameras together, or "
                           "raise max_time_difference_s here and pair_tolerance_s of its users",
                           1e-6 * std::abs(difference_ns_), 1e3 * options_.max_time_difference_s));
  }
  else if (lately.pairs == 0 && lately.undecodable > 0)
  {
    status->summary(DiagnosticStatus::ERROR, "no picture can be decoded; try pixel_format: YUYV");
  }
  else if (!warnings.empty())
  {
    status->summary(warnings.front().error ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, warnings.front().text);
  }
  else if (rate < LEAST_OF_RATE * expected)
  {
    status->summary(DiagnosticStatus::WARN,
                    format("%.1f pairs per second, the camera promises %.1f; in the dark shorten its exposure "
                           "(exposure_dynamic_framerate = 0), give it a USB bus of its own, or MJPG",
                           rate, expected));
  }
  else
  {
    status->summary(DiagnosticStatus::OK, format("%.1f pairs per second", rate));
  }
}

}  // namespace pi_vehicle
