#pragma once

#include <opencv2/calib3d.hpp>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "obstacles/matched_camera.h"

namespace pi_detect::obstacles
{

/// Disparity of rectified pairs. Pictures are matched at half size, with a quarter of the pixels and half of the
/// disparities, by semi-global matching (Hirschmueller 2008; OpenCV's StereoSGBM with three paths), which fills
/// surfaces without texture from their surroundings. Where half size is too coarse for the depth, block matching at
/// full size (OpenCV's StereoBM), over the small disparities only, takes its place: more precise, but with holes.
class DisparityMatcher
{
public:
  /// @param min_depth_m  wanted, along the optical axis; limited by the width of the picture, see minDepth().
  /// @param max_depth_m  farthest that is used.
  DisparityMatcher(const StereoGeometry& geometry, double min_depth_m, double max_depth_m);

  /// Of the disparity picture: at half size, if that does for all depths.
  const MatchedCamera& camera() const { return camera_; }

  /// Nearest depth that is searched [m].
  double minDepth() const { return near_.camera().fb / near_.maxDisparity(); }

  /// @return CV_32FC1 of the camera's size: fb / depth [px], not above 0: unknown. Valid until the next call.
  const cv::Mat& compute(const cv::Mat& left, const cv::Mat& right);

  /// The last pair at half size alone, without the holes of full size but with twice the noise. CV_32FC1, not above 0:
  /// unknown. Times coarseScale() it is in pixels of camera().
  const cv::Mat& coarse() const { return near_.disparity(); }
  double coarseScale() const { return camera_.fb / near_.camera().fb; }

private:
  /// Matching at one size.
  class Level
  {
  public:
    Level(const MatchedCamera& camera, cv::Ptr<cv::StereoMatcher> matcher);

    const MatchedCamera& camera() const { return camera_; }
    /// Largest disparity that is searched [px].
    double maxDisparity() const;
    /// @return CV_32FC1, as above. Valid until the next call.
    const cv::Mat& match(const cv::Mat& left, const cv::Mat& right);
    const cv::Mat& disparity() const { return disparity_; }  ///< of the last match

  private:
    MatchedCamera camera_;
    cv::Ptr<cv::StereoMatcher> matcher_;
    int padding_;  ///< at the left, so that columns whose partner is outside are matched too [px]
    cv::Mat left_, right_, fixed_point_, disparity_;
  };

  /// Disparities of far things from full size, of all others from half size.
  const cv::Mat& join(const cv::Mat& near, const cv::Mat& far);

  Level near_;  ///< half size
  std::optional<Level> far_;
  MatchedCamera camera_;
  cv::Mat small_left_, small_right_, joined_;
};

}  // namespace pi_detect::obstacles
