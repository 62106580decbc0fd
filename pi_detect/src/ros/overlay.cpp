#include "ros/overlay.h"

#include <pi_node/formatting.h>

#include <opencv2/imgproc.hpp>
#include <string>

#include "detector/draw_detections.h"

namespace pi_detect
{
namespace
{

using pi_node::format;

/// Of a detection and the track that it continued.
constexpr float MIN_SAME_OVERLAP = 0.5F;

/// A copy to draw on, BGR.
cv::Mat toBgr(const PictureView& view)
{
  const bool grey = view.format == PictureView::Format::MONO8;
  const cv::Mat shared(view.height, view.width, grey ? CV_8UC1 : CV_8UC3, const_cast<uint8_t*>(view.data), view.stride);
  cv::Mat picture;
  if (view.format == PictureView::Format::BGR8)
  {
    shared.copyTo(picture);
  }
  else
  {
    cv::cvtColor(shared, picture, grey ? cv::COLOR_GRAY2BGR : cv::COLOR_RGB2BGR);
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

cv::Mat drawOverlay(const FoundObjects& found, double rate_hz)
{
  const ModelDescription& model = found.detector->model();
  cv::Mat picture = toBgr(found.picture->view());
  drawDetections(found.detections, model.labels, &picture,
                 [&found](const Detection& detection)
                 {
                   const ObjectTrack* const track = trackOf(detection, found.tracks);
                   return track == nullptr ? "" : "#" + std::to_string(track->id) + " ";
                 });
  const std::string line = model.name + " " + toString(found.detector->target().used) + format(" %.1f FPS", rate_hz);
  const cv::Point corner(4, picture.rows - 6);
  cv::putText(picture, line, corner, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(0), 3, cv::LINE_AA);
  cv::putText(picture, line, corner, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(255), 1, cv::LINE_AA);
  return picture;
}

}  // namespace pi_detect
