#include "obstacles/disparity_matcher.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace pi_detect::obstacles
{

namespace
{

constexpr int BLOCK_PX = 11;
constexpr int STEPS_PER_PX = 16;    // of StereoBM's disparities
constexpr int MIN_TEXTURE = 800;    // sum of gradients in a block, each up to 31
constexpr int MIN_UNIQUENESS = 20;  // by which the second best match must be worse [%]

int atScale(int size, double downscale)
{
  return std::max(1, static_cast<int>(std::lround(size / downscale)));
}

int multipleOf16(double value)
{
  return std::max(16, 16 * static_cast<int>(std::ceil(value / 16.0)));
}

}  // namespace

DisparityMatcher::DisparityMatcher(const StereoGeometry& geometry, int max_disparity_px, double downscale)
  : camera_(geometry, atScale(geometry.width, downscale), atScale(geometry.height, downscale))
  , min_disparity_(static_cast<int>(std::floor(camera_.cx_difference)))
{
  const int disparities = multipleOf16(max_disparity_px / downscale);
  padding_ = std::max(0, disparities + min_disparity_);
  matcher_ = cv::StereoBM::create(disparities, BLOCK_PX);
  matcher_->setMinDisparity(min_disparity_);
  matcher_->setTextureThreshold(MIN_TEXTURE);
  matcher_->setUniquenessRatio(MIN_UNIQUENESS);
}

void DisparityMatcher::prepare(const cv::Mat& picture, cv::Mat* small, cv::Mat* padded) const
{
  const bool same = picture.cols == camera_.width && picture.rows == camera_.height;
  if (!same)
  {
    cv::resize(picture, *small, cv::Size(camera_.width, camera_.height), 0.0, 0.0, cv::INTER_AREA);
  }
  cv::copyMakeBorder(same ? picture : *small, *padded, 0, 0, padding_, 0, cv::BORDER_REPLICATE);
}

const cv::Mat& DisparityMatcher::compute(const cv::Mat& left, const cv::Mat& right)
{
  prepare(left, &small_, &left_);
  prepare(right, &small_, &right_);
  matcher_->compute(left_, right_, fixed_point_);
  const auto unknown = static_cast<int16_t>(STEPS_PER_PX * (min_disparity_ - 1));
  const auto offset = static_cast<float>(camera_.cx_difference);
  disparity_.create(camera_.height, camera_.width, CV_32FC1);
  for (int v = 0; v < camera_.height; ++v)
  {
    const int16_t* from = fixed_point_.ptr<int16_t>(v) + padding_;
    auto* to = disparity_.ptr<float>(v);
    for (int u = 0; u < camera_.width; ++u)
    {
      const float value = static_cast<float>(from[u]) * (1.0F / STEPS_PER_PX) - offset;
      const bool partner_outside = value > static_cast<float>(u);
      to[u] = from[u] <= unknown || value <= 0.0F || partner_outside ? -1.0F : value;
    }
  }
  return disparity_;
}

}  // namespace pi_detect::obstacles
