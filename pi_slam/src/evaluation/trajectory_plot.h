#pragma once

#include <pi_slam/trajectory_file.h>

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace pi_slam
{

/// One estimated trajectory of a plot.
struct PlottedTrajectory
{
  std::string name;                     ///< for the legend
  std::vector<StampedPose> poses;       ///< in the world of the truth (TrajectoryPlot::truth), stamps increasing
  std::vector<int64_t> error_stamps;    ///< of the errors; empty without truth
  std::vector<double> position_errors;  ///< [m], one per error_stamps
  std::vector<double> rotation_errors;  ///< [rad], likewise
};

/// A stretch of time that is shaded in the plots over time.
struct PlottedSpan
{
  std::string name;  ///< for the legend; equal ones share a colour
  int64_t from_ns = 0;
  int64_t to_ns = 0;
};

struct TrajectoryPlot
{
  std::string title;
  std::string subtitle;
  std::vector<StampedPose> truth;  ///< may be empty
  std::vector<PlottedTrajectory> trajectories;
  std::vector<PlottedSpan> spans;
};

/// Draws 1600x1000 px, BGR: the path from above (x, y) and from the side (x, z) at the same scale in both directions,
/// and the errors of position and rotation over time; without truth, distance from the start and heading in their
/// place. Text is ASCII; other characters are shown as '?'. Poses and errors that are not finite, or beyond 1e12, are
/// left out.
/// @throws std::invalid_argument without any trajectory, or for errors whose number is not that of their stamps.
cv::Mat drawTrajectoryPlot(const TrajectoryPlot& plot);

}  // namespace pi_slam
