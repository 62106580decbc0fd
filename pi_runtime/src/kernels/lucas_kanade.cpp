#include <pi_runtime/kernels/lucas_kanade.h>

#include <cfloat>
#include <cmath>
#include <stdexcept>
#include <string>

#include "kernels/codelet_arguments.h"
#include "kernels/lucas_kanade_window.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr float FARTHEST = 1e6f;  ///< positions beyond it are lost, before they leave the range of integers [px]
constexpr float SCALE = 1.0f / (1 << 20);  ///< of sums of products, so that they stay small in float
constexpr float OSCILLATION = 0.01f;       ///< two steps that cancel each other to this [px] end the search

enum class Search
{
  DONE,
  NO_TEXTURE,
  OUTSIDE,
};

bool usable(const Point2f& point)
{
  return std::abs(point.x) < FARTHEST && std::abs(point.y) < FARTHEST;
}

/// The pixel at or left of and above a position, and the rest.
struct Split
{
  explicit Split(const Point2f& point)
    : x(static_cast<int>(std::floor(point.x)))
    , y(static_cast<int>(std::floor(point.y)))
    , weights(point.x - static_cast<float>(x), point.y - static_cast<float>(y))
  {
  }
  /// True if no pixel of a window from here on can be inside of the image.
  bool outside(const ImageView<const uint8_t>& image, int window) const
  {
    return x < -window || x >= image.width || y < -window || y >= image.height;
  }

  int x;
  int y;
  BilinearWeights weights;
};

/// Solves for the displacement of one window on one level (Bouguet 2000, section 2.4).
class LevelSearch
{
public:
  LevelSearch(const ImageView<const uint8_t>& previous, const ImageView<const uint8_t>& next,
              const TrackOptions& options)
    : previous_(previous), next_(next), options_(options), half_(static_cast<float>(options.window - 1) * 0.5f)
  {
    window_.size = options.window;
  }

  /// @param from  in the previous image of this level.
  /// @param[in,out] to  guess, then result, in the next image of this level.
  Search run(const Point2f& from, Point2f* to)
  {
    const Split corner(Point2f{from.x - half_, from.y - half_});
    if (corner.outside(previous_.image(), options_.window))
    {
      return Search::OUTSIDE;
    }
    const GradientSums sums = cutWindow(&previous_, corner.x, corner.y, corner.weights, &window_);
    const float a11 = static_cast<float>(sums.xx) * SCALE;
    const float a12 = static_cast<float>(sums.xy) * SCALE;
    const float a22 = static_cast<float>(sums.yy) * SCALE;
    const float determinant = a11 * a22 - a12 * a12;
    const float root = std::sqrt((a11 - a22) * (a11 - a22) + 4.0f * a12 * a12);
    const float eigenvalue = (a22 + a11 - root) / static_cast<float>(2 * options_.window * options_.window);
    if (eigenvalue < options_.min_eigenvalue || determinant < FLT_EPSILON)
    {
      return Search::NO_TEXTURE;
    }
    return iterate(a11, a12, a22, 1.0f / determinant, to);
  }

  /// Mean absolute difference at the result. @return false if it is outside of the image.
  bool residual(const Point2f& to, float* mean)
  {
    const Split corner(Point2f{to.x - half_, to.y - half_});
    if (corner.outside(next_.image(), options_.window))
    {
      return false;
    }
    const float* patch = next_.cut(corner.x, corner.y, options_.window + 1);
    const auto sum = static_cast<float>(absoluteDifference(window_, patch, corner.weights));
    *mean = sum / static_cast<float>(32 * options_.window * options_.window);
    return true;
  }

private:
  Search iterate(float a11, float a12, float a22, float inverse, Point2f* to)
  {
    Point2f last{0.0f, 0.0f};
    for (int i = 0; i < options_.max_iterations; ++i)
    {
      const Split corner(Point2f{to->x - half_, to->y - half_});
      if (corner.outside(next_.image(), options_.window))
      {
        return Search::OUTSIDE;
      }
      const float* patch = next_.cut(corner.x, corner.y, options_.window + 1);
      const Mismatch mismatch = compareWindow(window_, patch, corner.weights);
      const float b1 = static_cast<float>(mismatch.x) * SCALE;
      const float b2 = static_cast<float>(mismatch.y) * SCALE;
      const Point2f step{(a12 * b2 - a22 * b1) * inverse, (a12 * b1 - a11 * b2) * inverse};
      to->x += step.x;
      to->y += step.y;
      if (step.x * step.x + step.y * step.y <= options_.epsilon * options_.epsilon)
      {
        break;
      }
      if (i > 0 && std::abs(step.x + last.x) < OSCILLATION && std::abs(step.y + last.y) < OSCILLATION)
      {
        to->x -= step.x * 0.5f;
        to->y -= step.y * 0.5f;
        break;
      }
      last = step;
    }
    return Search::DONE;
  }

  PatchCutter previous_;
  PatchCutter next_;
  const TrackOptions& options_;
  const float half_;  ///< from the window's first pixel to its middle [px]
  Window window_;
};

/// @return true if the point was found.
bool trackPoint(const uint8_t* previous_pyramid, const uint8_t* next_pyramid, const PyramidLayout& layout,
                const TrackOptions& options, const Point2f& previous, Point2f* next, float* residual)
{
  if (!usable(previous) || !usable(*next))
  {
    return false;
  }
  const float smallest = 1.0f / static_cast<float>(1 << (layout.levels - 1));
  Point2f to{next->x * smallest, next->y * smallest};
  bool found = false;
  for (int i = layout.levels - 1; i >= 0; --i)
  {
    const float scale = 1.0f / static_cast<float>(1 << i);
    LevelSearch search(layout.view(previous_pyramid, i), layout.view(next_pyramid, i), options);
    found = search.run(Point2f{previous.x * scale, previous.y * scale}, &to) == Search::DONE;
    if (!usable(to))
    {
      return false;
    }
    if (i == 0)
    {
      *next = to;
      return found && search.residual(to, residual);
    }
    to = Point2f{to.x * 2.0f, to.y * 2.0f};
  }
  return found;
}

}  // namespace

void TrackOptions::validate() const
{
  const char* name = "TrackOptions";
  requireBetween(name, "width", width, 1, 32768);
  requireBetween(name, "height", height, 1, 32768);
  requireBetween(name, "levels", levels, 1, MAX_PYRAMID_LEVELS);
  requireBetween(name, "window", window, 3, MAX_TRACK_WINDOW);
  requireBetween(name, "max_iterations", max_iterations, 1, 100);
  if (!(epsilon >= 0.0f) || !(min_eigenvalue >= 0.0f))
  {
    throw std::invalid_argument("TrackOptions: epsilon = " + std::to_string(epsilon) +
                                ", min_eigenvalue = " + std::to_string(min_eigenvalue) + ", must both be at least 0");
  }
}

void trackPoints(const uint8_t* previous_pyramid, const uint8_t* next_pyramid, const TrackOptions& options,
                 const Point2f* previous, Point2f* next, uint8_t* status, float* residual, size_t begin, size_t end)
{
  options.validate();
  const PyramidLayout layout(options.width, options.height, options.levels);
  for (size_t i = begin; i < end; ++i)
  {
    residual[i] = 0.0f;
    status[i] = trackPoint(previous_pyramid, next_pyramid, layout, options, previous[i], &next[i], &residual[i]);
  }
}

}  // namespace pi_runtime::kernels
