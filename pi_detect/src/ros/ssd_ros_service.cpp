// The thread ssd_service of SsdRos.

#include "detector/draw_detections.h"
#include <pi_detect/ros/conversions.h>
#include "ros/ssd_ros.h"
#include <pi_node/formatting.h>

#include <exception>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

namespace pi_detect
{
namespace
{

using pi_node::format;

namespace zero_copy = pi_os_transport::zero_copy;

/// Of a detection and the track that it continued.
constexpr float MIN_SAME_OVERLAP = 0.5F;

/// A copy to draw on, BGR.
cv::Mat toBgr(const PictureView& view)
{
  const cv::Mat shared(view.height, view.width, view.format == PictureView::Format::MONO8 ? CV_8UC1 : CV_8UC3,
                       const_cast<uint8_t*>(view.data), view.stride);
  cv::Mat picture;
  switch (view.format)
  {
    case PictureView::Format::BGR8:
      shared.copyTo(picture);
      break;
    case PictureView::Format::RGB8:
      cv::cvtColor(shared, picture, cv::COLOR_RGB2BGR);
      break;
    case PictureView::Format::MONO8:
      cv::cvtColor(shared, picture, cv::COLOR_GRAY2BGR);
      break;
  }
  return picture;
}

/// The track that a detection continued; null: none.
const ObjectTrack* trackOf(const Detection& detection, const std::vector<ObjectTrack>& tracks)
{
  const ObjectTrack* best = nullptr;
  for (const ObjectTrack& track : tracks)
  {
    const float common = overlap(track.box, detection.box);
    if (common >= MIN_SAME_OVERLAP && (best == nullptr || common > overlap(best->box, detection.box)))
    {
      best = &track;
    }
  }
  return best;
}

}  // namespace

bool SsdRos::detect(DetectObjects::Request& request, DetectObjects::Response& response)
{
  response.detections.header = request.image.header;
  // The request outlives the call.
  const sensor_msgs::ImageConstPtr image(&request.image, [](const sensor_msgs::Image*) {});
  Call call{zero_copy::toHandle(image), &response};
  std::unique_lock<std::mutex> lock(mutex_);
  if (worker_ended_)
  {
    return false;
  }
  if (!detector_)
  {
    response.message = problem_.empty() ? "the model is being loaded: " + loading_ : problem_;
    return true;
  }
  calls_.push_back(&call);
  work_changed_.notify_one();
  call_done_.wait(lock, [this, &call] { return call.done || worker_ended_; });
  return call.done;
}

void SsdRos::updateSubscription()
{
  const bool wanted = options_.always_on || detections_.getNumSubscribers() > 0 || tracks_.getNumSubscribers() > 0 ||
                      overlay_.getNumSubscribers() > 0;
  if (wanted == subscribed_)
  {
    return;
  }
  subscribed_ = wanted;
  if (!wanted)
  {
    image_.shutdown();
    std::lock_guard<std::mutex> lock(mutex_);
    picture_.reset();
    return;
  }
  came_at_ = Clock::now().time_since_epoch().count();
  try
  {
    const image_transport::TransportHints hints(options_.image_transport, ros::TransportHints().tcpNoDelay(),
                                                private_node_);
    image_.subscribe(input_node_, input_transport_, "image", 1, options_.zero_copy, hints,
                     [this](const zero_copy::ImageHandle& message) { onImage(message); });
  }
  catch (const std::exception& error)
  {
    subscribed_ = false;
    warnings_.error(topic_ + ": " + error.what());
  }
}

void SsdRos::publishOverlay(const Overlay& overlay)
{
  try
  {
    const ModelDescription& model = overlay.detector->model();
    cv::Mat picture = toBgr(overlay.picture->view());
    // The best on top.
    for (auto detection = overlay.detections.rbegin(); detection != overlay.detections.rend(); ++detection)
    {
      const ObjectTrack* const track = trackOf(*detection, overlay.tracks);
      const auto label = model.labels.find(detection->class_id);
      drawBox(detection->box,
              (track == nullptr ? "" : "#" + std::to_string(track->id) + " ") +
                  (label == model.labels.end() ? std::to_string(detection->class_id) : label->second) +
                  format(" %.2f", detection->score),
              colourOf(detection->class_id), &picture);
    }
    const std::string line =
        model.name + " " + toString(overlay.detector->target().used) + format(" %.1f FPS", diagnostics_.rate());
    const cv::Point corner(4, picture.rows - 6);
    cv::putText(picture, line, corner, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(0), 3, cv::LINE_AA);
    cv::putText(picture, line, corner, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(255), 1, cv::LINE_AA);
    overlay_.publish(toImage(picture, zero_copy::standardHeader(overlay.picture->message().header)));
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
  figures.topic = topic_;
  figures.subscribed = subscribed_;
  figures.pictures = pictures_;
  figures.silent_s = std::chrono::duration<double>(Clock::now().time_since_epoch() - Clock::duration(came_at_)).count();
  figures.calls = calls_served_;
  figures.threads = cv::getNumThreads();
  figures.use_runtime = runtime_ != nullptr;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    figures.dropped = dropped_;
    figures.left_out = left_out_;
    figures.loading = loading_;
    figures.problem = problem_;
    if (detector_)
    {
      figures.model = detector_->model().name;
      figures.codelet = detector_->codeletName();
      figures.target = detector_->target();
    }
  }
  if (figures.subscribed && figures.silent_s > options_.input_timeout_s)
  {
    warnings_.warn(topic_ + format(": nothing for %.1f s", figures.silent_s) +
                   "; check that the camera runs and that the topic is its");
  }
  diagnostics_.update(figures);
}

}  // namespace pi_detect
