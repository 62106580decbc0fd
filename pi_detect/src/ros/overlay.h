#pragma once

#include <pi_detect/detector.h>
#include <pi_detect/object_tracker.h>
#include <pi_detect/ros/message_picture.h>

#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace pi_detect
{

/// A picture with what was found in it.
struct FoundObjects
{
  std::shared_ptr<const MessagePicture> picture;
  Detections detections;
  std::vector<ObjectTrack> tracks;
  std::shared_ptr<const Detector> detector;
};

/// A copy of the picture (BGR) with boxes, labels, ids of tracks, model and rate. @param rate_hz  of pictures.
cv::Mat drawOverlay(const FoundObjects& found, double rate_hz);

}  // namespace pi_detect
