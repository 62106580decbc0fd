#pragma once

#include <Eigen/Core>
#include <vector>

#include "front_end/picture_kernels.h"
#include "front_end/stereo_geometry.h"

namespace pi_slam::front_end
{

/// Looks for a point of one camera along its epipolar curve in the other camera's picture, from infinity to the nearest
/// distance: patches of 8 x 8 px are compared by zero-mean normalised correlation, which neither brightness nor
/// contrast of the cameras changes.
class CurveSearch
{
public:
  struct Candidate
  {
    Pixel pixel;  ///< in the full picture, to about 1 px of the level that was searched
    float score;  ///< correlation, in [-1, 1]
  };

  /// @param level  of the pyramids that `search` is given.
  CurveSearch(const StereoGeometry& geometry, double min_distance_m, int level);

  /// @param from_picture,to_picture  the level of the pyramids of camera `from` and of the other one.
  /// @return up to 3 peaks of the correlation that are nearly as high as the highest one, best first; none if nothing
  ///         is like the patch. Valid until the next call.
  const std::vector<Candidate>& search(int from, const Picture& from_picture, const Picture& to_picture,
                                       const Eigen::Vector2d& pixel, const Eigen::Vector3d& bearing);

private:
  void sampleCurve(int from, const Eigen::Vector3d& bearing);

  const StereoGeometry& geometry_;
  const double largest_inverse_distance_;
  const int level_;
  std::vector<Eigen::Vector2f> curve_;  ///< pixels of the level
  std::vector<float> scores_;
  std::vector<Candidate> candidates_;
};

}  // namespace pi_slam::front_end
