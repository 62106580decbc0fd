#pragma once

#include <opencv2/calib3d.hpp>
#include <opencv2/core/mat.hpp>

#include "obstacles/matched_camera.h"

namespace pi_detect::obstacles
{

/// Disparity of rectified pairs by block matching (OpenCV's StereoBM: sums of absolute differences of the horizontal
/// gradient). Pixels without texture have no disparity, nor have those with a second match that is about as good
/// (repetitive patterns). A check from right to left would find no more wrong matches and take a sixth longer.
class DisparityMatcher
{
public:
  DisparityMatcher(const StereoGeometry& geometry, int max_disparity_px, double downscale);

  const MatchedCamera& camera() const { return camera_; }

  /// @return CV_32FC1 of the camera's size: fb / depth [px], not above 0: unknown. Valid until the next call.
  const cv::Mat& compute(const cv::Mat& left, const cv::Mat& right);

private:
  /// The picture at the camera's size with a margin at the left, so that columns whose partner is outside are matched
  /// too.
  void prepare(const cv::Mat& picture, cv::Mat* small, cv::Mat* padded) const;

  MatchedCamera camera_;
  int min_disparity_;
  int padding_;
  cv::Ptr<cv::StereoBM> matcher_;
  cv::Mat small_, left_, right_, fixed_point_, disparity_;
};

}  // namespace pi_detect::obstacles
