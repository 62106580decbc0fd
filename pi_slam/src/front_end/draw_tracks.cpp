#include "front_end/stereo_tracker.h"

#include <pi_node/formatting.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <unordered_map>

namespace pi_slam
{

namespace
{

constexpr int RADIUS_PX = 3;
constexpr float OLD_AGE = 40.0F;  ///< pairs from which on a feature is drawn in the last colour

/// Red for new features, over green, to blue for old ones.
cv::Scalar colourOf(uint32_t age)
{
  const float part = std::min(1.0F, static_cast<float>(age) / OLD_AGE);
  const auto level = [](float value) { return 255.0 * std::min(1.0F, std::max(0.0F, value)); };
  return cv::Scalar(level(2.0F * part - 1.0F), level(1.0F - std::abs(2.0F * part - 1.0F)), level(1.0F - 2.0F * part));
}

cv::Mat toBgr(const cv::Mat& picture, const cv::Size& size)
{
  if (picture.empty())
  {
    return cv::Mat::zeros(size, CV_8UC3);
  }
  if (picture.size() != size || picture.type() != CV_8UC1)
  {
    throw std::invalid_argument("drawTracks: pictures of " + pi_node::sizeText(size.width, size.height) + " and " +
                                pi_node::sizeText(picture.cols, picture.rows) + " px, type " +
                                cv::typeToString(picture.type()) + "; both must be CV_8UC1 of the same size");
  }
  cv::Mat bgr;
  cv::cvtColor(picture, bgr, cv::COLOR_GRAY2BGR);
  return bgr;
}

cv::Point2f inPair(const FeatureObservation& feature, int camera, int width)
{
  return {feature.pixel[camera].x() + static_cast<float>(camera * width), feature.pixel[camera].y()};
}

const FeatureObservation* find(const FrameFeatures& frame, int64_t id)
{
  const auto found = std::lower_bound(frame.features.begin(), frame.features.end(), id,
                                      [](const FeatureObservation& feature, int64_t key) { return feature.id < key; });
  return found != frame.features.end() && found->id == id ? &*found : nullptr;
}

}  // namespace

cv::Mat drawTracks(const cv::Mat& left, const cv::Mat& right, const FrameFeatures& features,
                   const std::vector<FrameFeatures>& earlier)
{
  const cv::Size size = left.empty() ? right.size() : left.size();
  if (size.empty())
  {
    throw std::invalid_argument("drawTracks: both pictures are empty; one is needed");
  }
  cv::Mat canvas;
  cv::hconcat(toBgr(left, size), toBgr(right, size), canvas);
  for (const FeatureObservation& feature : features.features)
  {
    const cv::Scalar colour = colourOf(feature.age);
    const bool both = feature.seen[LEFT] && feature.seen[RIGHT];
    for (int camera = LEFT; camera <= RIGHT; ++camera)
    {
      if (!feature.seen[camera])
      {
        continue;
      }
      cv::Point2f end = inPair(feature, camera, size.width);
      cv::circle(canvas, end, RADIUS_PX, colour, both ? cv::FILLED : 1, cv::LINE_AA);
      for (auto frame = earlier.rbegin(); frame != earlier.rend(); ++frame)
      {
        const FeatureObservation* before = find(*frame, feature.id);
        if (before == nullptr || !before->seen[camera])
        {
          break;
        }
        const cv::Point2f start = inPair(*before, camera, size.width);
        cv::line(canvas, start, end, colour, 1, cv::LINE_AA);
        end = start;
      }
    }
  }
  return canvas;
}

}  // namespace pi_slam
