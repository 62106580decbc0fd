#pragma once

#include <pi_detect/object_tracker.h>
#include <pi_detect/stereo_obstacles.h>

#include <vector>

namespace pi_detect::obstacles
{

/// The detector's track of each measurement, or -1. A track's box may hold several pieces of its object, but
/// nothing behind it.
/// @param min_overlap  part of a measurement's picture box inside the track's box, to take its label.
std::vector<int> chooseTracks(const std::vector<ObstacleMeasurement>& measurements,
                              const std::vector<ObjectTrack>& tracks, double min_overlap);

}  // namespace pi_detect::obstacles
