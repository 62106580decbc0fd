#include "obstacles/disparity_matcher.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace pi_detect::obstacles
{

namespace
{

constexpr int STEPS_PER_PX = 16;  // of OpenCV's disparities
constexpr int RANGE_STEP = 16;    // OpenCV searches a multiple of these

// Half size. Block, penalties and prefilter are those of OpenCV's documentation and example. Uniqueness (5 to 15
// there), speckles (50 to 200) and the least disparities keep the noise of covered lenses from being a surface. What
// stands on the ground is connected with it, so it is no speckle.
constexpr int SMALL_BLOCK_PX = 3;
constexpr int SMALL_STEP_PENALTY = 8 * SMALL_BLOCK_PX * SMALL_BLOCK_PX;
constexpr int LARGE_STEP_PENALTY = 32 * SMALL_BLOCK_PX * SMALL_BLOCK_PX;
constexpr int LEFT_RIGHT_PX = 1;
constexpr int MAX_GRADIENT = 63;
constexpr int UNIQUENESS = 15;  // by which the second best match must be worse [%]
constexpr int SPECKLE_PX = 100;
constexpr int SPECKLE_STEP_PX = 1;
constexpr int MIN_DISPARITIES = 2 * RANGE_STEP;

// Full size: what is not certain is left to half size. Three times the disparities that it has to tell apart, so that a
// wrong match has rivals.
constexpr int FAR_DISPARITIES = 32;
constexpr int BLOCK_PX = 11;
constexpr int MIN_TEXTURE = 800;    // sum of gradients in a block, each up to 31
constexpr int MIN_UNIQUENESS = 20;  // as above

// Half size doubles the noise of a disparity. Above this disparity it is below 5 % of the depth. [px at full size]
constexpr double COARSE_BELOW_PX = 2.0 * DISPARITY_SIGMA_PX / 0.05;
constexpr double FAR_MARGIN_PX = 2.0;  // at the end of the far range, for what both sizes see differently

int halfOf(int size)
{
  return (size + 1) / 2;
}

/// Disparities to search at half size. With more than half of the width, most of the picture would have no partner.
int disparitiesOf(const MatchedCamera& camera, double min_depth_m)
{
  const double wanted = std::min(camera.fb / min_depth_m + camera.cx_difference, 0.5 * camera.width);
  return std::max(MIN_DISPARITIES, RANGE_STEP * static_cast<int>(std::ceil(wanted / RANGE_STEP)));
}

cv::Ptr<cv::StereoMatcher> halfSizeMatcher(int disparities)
{
  return cv::StereoSGBM::create(0, disparities, SMALL_BLOCK_PX, SMALL_STEP_PENALTY, LARGE_STEP_PENALTY, LEFT_RIGHT_PX,
                                MAX_GRADIENT, UNIQUENESS, SPECKLE_PX, SPECKLE_STEP_PX, cv::StereoSGBM::MODE_SGBM_3WAY);
}

cv::Ptr<cv::StereoMatcher> fullSizeMatcher()
{
  const cv::Ptr<cv::StereoBM> matcher = cv::StereoBM::create(FAR_DISPARITIES, BLOCK_PX);
  matcher->setTextureThreshold(MIN_TEXTURE);
  matcher->setUniquenessRatio(MIN_UNIQUENESS);
  return matcher;
}

}  // namespace

DisparityMatcher::Level::Level(const MatchedCamera& camera, cv::Ptr<cv::StereoMatcher> matcher)
  : camera_(camera), matcher_(std::move(matcher))
{
  matcher_->setMinDisparity(static_cast<int>(std::floor(camera_.cx_difference)));
  padding_ = std::max(0, matcher_->getNumDisparities() + matcher_->getMinDisparity());
}

double DisparityMatcher::Level::maxDisparity() const
{
  return matcher_->getMinDisparity() + matcher_->getNumDisparities() - camera_.cx_difference;
}

const cv::Mat& DisparityMatcher::Level::match(const cv::Mat& left, const cv::Mat& right)
{
  cv::copyMakeBorder(left, left_, 0, 0, padding_, 0, cv::BORDER_REPLICATE);
  cv::copyMakeBorder(right, right_, 0, 0, padding_, 0, cv::BORDER_REPLICATE);
  matcher_->compute(left_, right_, fixed_point_);
  const auto unknown = static_cast<int16_t>(STEPS_PER_PX * (matcher_->getMinDisparity() - 1));
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

DisparityMatcher::DisparityMatcher(const StereoGeometry& geometry, double min_depth_m, double max_depth_m)
  : near_(
        [&]
        {
          const MatchedCamera half(geometry, halfOf(geometry.width), halfOf(geometry.height));
          return Level(half, halfSizeMatcher(disparitiesOf(half, min_depth_m)));
        }())
  , camera_(geometry, geometry.width, geometry.height)
{
  if (camera_.fb / max_depth_m < COARSE_BELOW_PX)
  {
    far_.emplace(camera_, fullSizeMatcher());
  }
  else
  {
    camera_ = near_.camera();
  }
}

const cv::Mat& DisparityMatcher::compute(const cv::Mat& left, const cv::Mat& right)
{
  const cv::Size half(near_.camera().width, near_.camera().height);
  cv::resize(left, small_left_, half, 0.0, 0.0, cv::INTER_AREA);
  cv::resize(right, small_right_, half, 0.0, 0.0, cv::INTER_AREA);
  const cv::Mat& near = near_.match(small_left_, small_right_);
  return far_ ? join(near, far_->match(left, right)) : near;
}

const cv::Mat& DisparityMatcher::join(const cv::Mat& near, const cv::Mat& far)
{
  const auto scale = static_cast<float>(camera_.fb / near_.camera().fb);
  const auto far_end = static_cast<float>(far_->maxDisparity() - FAR_MARGIN_PX);
  const auto coarse_below = static_cast<float>(COARSE_BELOW_PX);
  joined_.create(camera_.height, camera_.width, CV_32FC1);
  for (int v = 0; v < camera_.height; ++v)
  {
    const auto* from_near = near.ptr<float>(v / 2);
    const auto* from_far = far.ptr<float>(v);
    auto* to = joined_.ptr<float>(v);
    for (int u = 0; u < camera_.width; ++u)
    {
      // A block that sees nearer things than it searches finds something wrong: both sizes have to agree.
      const float coarse = scale * from_near[u / 2];
      const bool agree = coarse > 0.0F && from_far[u] > 0.0F && std::abs(from_far[u] - coarse) <= scale;
      to[u] = agree && coarse < far_end ? from_far[u] : coarse >= coarse_below ? coarse : -1.0F;
    }
  }
  return joined_;
}

}  // namespace pi_detect::obstacles
