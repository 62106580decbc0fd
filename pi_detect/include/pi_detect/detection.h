#pragma once

#include <algorithm>
#include <vector>

namespace pi_detect
{

/// A box in a picture [px], from the outer edge of its first pixel (x1, y1) to that of its last (x2, y2). The box lies
/// inside the picture unless the comment of a field says otherwise.
struct Box
{
  float x1 = 0.0F;
  float y1 = 0.0F;
  float x2 = 0.0F;
  float y2 = 0.0F;

  float width() const { return x2 - x1; }
  float height() const { return y2 - y1; }
  /// 0 if width or height is negative.
  float area() const { return std::max(0.0F, width()) * std::max(0.0F, height()); }
};

/// Area that both boxes cover [px^2].
inline float intersection(const Box& a, const Box& b)
{
  return Box{std::max(a.x1, b.x1), std::max(a.y1, b.y1), std::min(a.x2, b.x2), std::min(a.y2, b.y2)}.area();
}

/// Intersection over union, 0 to 1; 0 if both are empty.
inline float overlap(const Box& a, const Box& b)
{
  const float common = intersection(a, b);
  const float all = a.area() + b.area() - common;
  return all > 0.0F ? common / all : 0.0F;
}

/// An object found in a picture.
struct Detection
{
  int class_id = -1;   ///< key into ModelDescription::labels
  float score = 0.0F;  ///< 0 to 1
  Box box;             ///< in pixels of the whole picture, inside it
};
using Detections = std::vector<Detection>;

/// Scores of a network's detections for tracking (ByteTrack, Zhang et al. 2022). They belong to the network: the same
/// score means a different chance to be right in each.
struct TrackerScores
{
  double high = 0.6;  ///< of a detection that may begin a track; others only continue one. Default: ByteTrack's
  double low = 0.4;   ///< detections below are ignored. Default: where one of ten is right with the COCO SSD
};

/// Greedy non-maximum suppression across all classes, for networks that give one object two labels: of boxes that
/// overlap more than the threshold, the one with the best score stays. Sorts by score, best first.
void suppressAcrossClasses(float overlap_threshold, Detections* detections);

}  // namespace pi_detect
