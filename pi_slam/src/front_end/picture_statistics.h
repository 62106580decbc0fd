#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "front_end/picture_kernels.h"

namespace pi_slam::front_end
{

struct PictureStatistics
{
  double mean = 0.0;      ///< [grey levels]
  double contrast = 0.0;  ///< standard deviation [grey levels]
};

/// @param picture  a small level of a pyramid: noise is averaged out there, and texture is not.
PictureStatistics describePicture(const Picture& picture);

/// Ratio of brightness of two pictures at points that show the same things: median of the ratios of patches of 4 x 4
/// px.
/// @param points  in the first and the second picture, each in pixels of these levels.
/// @return first over second; nullopt for fewer than 8 points with patches that are neither dark nor white.
std::optional<double> brightnessRatio(const Picture& first, const Picture& second,
                                      const std::vector<std::pair<Pixel, Pixel>>& points);

/// Multiplies all pixels of a pyramid.
/// @param gain  in (0, 16).
void multiplyPyramid(const Pyramid& pyramid, double gain);

/// True if there is nothing to be seen: black, white, or a lens cap's grey.
bool isBlank(const PictureStatistics& statistics);

}  // namespace pi_slam::front_end
