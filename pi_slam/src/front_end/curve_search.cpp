#include "front_end/curve_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core/hal/intrin.hpp>

namespace pi_slam::front_end
{

namespace
{

constexpr int SIDE = 8;       ///< of the patches [px of the level]
constexpr int SEGMENTS = 16;  ///< straight ones that stand for the curve
constexpr size_t MOST_CANDIDATES = 3;
constexpr float LEAST_SCORE = 0.7F;
constexpr float LEAST_PART = 0.9F;          ///< of the best score
constexpr double BEYOND_INFINITY_PX = 2.0;  ///< for errors of the calibration and of the corner [px]
constexpr float NOWHERE = -2.0F;

/// Sums over a patch and its rows.
struct Patch
{
  cv::v_uint8x16 rows[SIDE / 2];  ///< two each
  int sum;
  float deviation;  ///< root of the summed squared differences from the mean
};

bool inside(const Picture& picture, int x, int y)
{
  return x >= 0 && y >= 0 && x + SIDE <= picture.width && y + SIDE <= picture.height;
}

Patch cut(const Picture& picture, int x, int y)
{
  Patch patch;
  cv::v_uint32x4 squares = cv::v_setzero_u32();
  cv::v_uint32x4 sums = cv::v_setzero_u32();
  const cv::v_uint8x16 ones = cv::v_setall_u8(1);
  for (int i = 0; i < SIDE / 2; ++i)
  {
    patch.rows[i] = cv::v_load_halves(picture.row(y + 2 * i) + x, picture.row(y + 2 * i + 1) + x);
    squares += cv::v_dotprod_expand(patch.rows[i], patch.rows[i]);
    sums += cv::v_dotprod_expand(patch.rows[i], ones);
  }
  patch.sum = static_cast<int>(cv::v_reduce_sum(sums));
  const float variance = static_cast<float>(cv::v_reduce_sum(squares)) -
                         static_cast<float>(patch.sum) * static_cast<float>(patch.sum) / (SIDE * SIDE);
  patch.deviation = std::sqrt(std::max(variance, 0.0F));
  return patch;
}

float correlation(const Patch& a, const Patch& b)
{
  cv::v_uint32x4 products = cv::v_setzero_u32();
  for (int i = 0; i < SIDE / 2; ++i)
  {
    products += cv::v_dotprod_expand(a.rows[i], b.rows[i]);
  }
  const float covariance = static_cast<float>(cv::v_reduce_sum(products)) -
                           static_cast<float>(a.sum) * static_cast<float>(b.sum) / (SIDE * SIDE);
  const float scale = a.deviation * b.deviation;
  return scale > 1.0F ? covariance / scale : NOWHERE;
}

/// First pixel of the patch around a position.
int corner(float position)
{
  return static_cast<int>(std::lround(position - 0.5F * (SIDE - 1)));
}

}  // namespace

CurveSearch::CurveSearch(const StereoGeometry& geometry, double min_distance_m, int level)
  : geometry_(geometry), largest_inverse_distance_(1.0 / min_distance_m), level_(level)
{
}

void CurveSearch::sampleCurve(int from, const Eigen::Vector3d& bearing)
{
  curve_.clear();
  const CameraModel& camera = geometry_.camera(1 - from);
  const double first = -BEYOND_INFINITY_PX / geometry_.disparityScale();
  const float scale = 1.0F / static_cast<float>(1 << level_);
  std::optional<Eigen::Vector2f> last;
  for (int i = 0; i <= SEGMENTS; ++i)
  {
    const double inverse_distance = first + (largest_inverse_distance_ - first) * i / SEGMENTS;
    const std::optional<Eigen::Vector2d> full = camera.project(geometry_.transfer(from, bearing, inverse_distance));
    if (!full)
    {
      break;
    }
    const Eigen::Vector2f pixel = scale * full->cast<float>();
    // A segment longer than the picture starts or ends far outside of it.
    const float length = last ? (pixel - *last).norm() : 0.0F;
    const auto steps = static_cast<int>(std::ceil(std::min(length, static_cast<float>(2 * camera.width))));
    for (int step = 1; step <= steps; ++step)
    {
      const float part = static_cast<float>(step) / static_cast<float>(steps);
      curve_.emplace_back((1.0F - part) * *last + part * pixel);
    }
    last = pixel;
  }
}

const std::vector<CurveSearch::Candidate>& CurveSearch::search(int from, const Picture& from_picture,
                                                               const Picture& to_picture, const Eigen::Vector2d& pixel,
                                                               const Eigen::Vector3d& bearing)
{
  candidates_.clear();
  const float scale = 1.0F / static_cast<float>(1 << level_);
  const Eigen::Vector2f centre = scale * pixel.cast<float>();
  const int x = corner(centre.x());
  const int y = corner(centre.y());
  if (!inside(from_picture, x, y))
  {
    return candidates_;
  }
  const Patch patch = cut(from_picture, x, y);
  // What rounding takes from the middle of the patch here is missing there, too.
  const Eigen::Vector2f rest(centre.x() - static_cast<float>(x), centre.y() - static_cast<float>(y));
  const Eigen::Vector2f shift = rest - Eigen::Vector2f::Constant(0.5F * (SIDE - 1));
  sampleCurve(from, bearing);
  scores_.assign(curve_.size(), NOWHERE);
  float best = NOWHERE;
  for (size_t i = 0; i < curve_.size(); ++i)
  {
    const Eigen::Vector2f middle = curve_[i] - shift;
    if (!(std::abs(middle.x()) < 1e6F && std::abs(middle.y()) < 1e6F))
    {
      continue;
    }
    const int to_x = corner(middle.x());
    const int to_y = corner(middle.y());
    if (inside(to_picture, to_x, to_y))
    {
      scores_[i] = correlation(patch, cut(to_picture, to_x, to_y));
      best = std::max(best, scores_[i]);
    }
  }
  const float least = std::max(LEAST_SCORE, LEAST_PART * best);
  for (size_t i = 0; i < scores_.size(); ++i)
  {
    const float before = i > 0 ? scores_[i - 1] : NOWHERE;
    const float after = i + 1 < scores_.size() ? scores_[i + 1] : NOWHERE;
    if (scores_[i] >= least && scores_[i] > before && scores_[i] >= after)
    {
      candidates_.push_back({Pixel{curve_[i].x() / scale, curve_[i].y() / scale}, scores_[i]});
    }
  }
  std::stable_sort(candidates_.begin(), candidates_.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  candidates_.resize(std::min(candidates_.size(), MOST_CANDIDATES));
  return candidates_;
}

}  // namespace pi_slam::front_end
