#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/picture_view.h>

#include <Eigen/Core>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace pi_detect
{

/// Where a point of the still surroundings in the last picture [px] is in this one [px]. Empty: unknown, or the camera
/// stands still.
using PictureMotion = std::function<Eigen::Vector2d(const Eigen::Vector2d&)>;

/// Estimates how the camera's motion moves the picture: corners are followed by optical flow (Lucas and Kanade 1981,
/// pyramids after Bouguet 2000), and the shift, turn and scale on which most of them agree is taken (RANSAC). So it
/// holds for the far background; what is near moves more. Not thread safe.
class PictureMotionEstimator
{
public:
  /// Takes the next picture. The motion since the last one is estimated only if asked for.
  /// @param moving  boxes of the last picture in which no corners are followed.
  /// @param wanted  false: only remembers the picture.
  /// @return empty for the first picture, another size, too few corners, or corners that do not agree.
  PictureMotion update(const PictureView& picture, const std::vector<Box>& moving, bool wanted = true);

  void clear() { last_.release(); }

private:
  cv::Mat last_;        ///< grey, reduced
  double scale_ = 1.0;  ///< of the reduced picture
};

}  // namespace pi_detect
