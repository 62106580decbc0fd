#include "front_end/picture_statistics.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core/hal/intrin.hpp>

namespace pi_slam::front_end
{

namespace
{

/// Weakest contrast of a picture in which corners of 5 grey levels, the least that is looked for, are more than noise.
constexpr double LEAST_CONTRAST = 2.0;
constexpr int PATCH = 4;  ///< side of the patches for ratios [px]
constexpr int DARK = 15;  ///< patches outside of these bounds tell nothing about the gain [grey levels]
constexpr int WHITE = 235;
constexpr size_t LEAST_RATIOS = 8;

/// Mean grey level of a patch; below 0 if it is not inside.
double patchMean(const Picture& picture, const Pixel& middle)
{
  if (!(middle.x >= 0.0F && middle.y >= 0.0F && middle.x < static_cast<float>(picture.width) &&
        middle.y < static_cast<float>(picture.height)))
  {
    return -1.0;
  }
  const int x = static_cast<int>(middle.x) - PATCH / 2 + 1;
  const int y = static_cast<int>(middle.y) - PATCH / 2 + 1;
  if (x < 0 || y < 0 || x + PATCH > picture.width || y + PATCH > picture.height)
  {
    return -1.0;
  }
  int sum = 0;
  for (int i = 0; i < PATCH; ++i)
  {
    const uint8_t* row = picture.row(y + i) + x;
    for (int k = 0; k < PATCH; ++k)
    {
      sum += row[k];
    }
  }
  return static_cast<double>(sum) / (PATCH * PATCH);
}

}  // namespace

PictureStatistics describePicture(const Picture& picture)
{
  uint64_t sum = 0;
  uint64_t squares = 0;
  for (int y = 0; y < picture.height; ++y)
  {
    const uint8_t* row = picture.row(y);
    uint32_t row_sum = 0;
    uint32_t row_squares = 0;  // 8192 px of 255^2 fit
    for (int x = 0; x < picture.width; ++x)
    {
      row_sum += row[x];
      row_squares += static_cast<uint32_t>(row[x]) * row[x];
    }
    sum += row_sum;
    squares += row_squares;
  }
  const double count = static_cast<double>(picture.width) * picture.height;
  PictureStatistics statistics;
  statistics.mean = static_cast<double>(sum) / count;
  statistics.contrast =
      std::sqrt(std::max(0.0, static_cast<double>(squares) / count - statistics.mean * statistics.mean));
  return statistics;
}

std::optional<double> brightnessRatio(const Picture& first, const Picture& second,
                                      const std::vector<std::pair<Pixel, Pixel>>& points)
{
  std::vector<double> ratios;
  ratios.reserve(points.size());
  for (const auto& [in_first, in_second] : points)
  {
    const double a = patchMean(first, in_first);
    const double b = patchMean(second, in_second);
    if (std::min(a, b) >= DARK && std::max(a, b) <= WHITE)
    {
      ratios.push_back(a / b);
    }
  }
  if (ratios.size() < LEAST_RATIOS)
  {
    return std::nullopt;
  }
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  return *middle;
}

void multiplyPyramid(const Pyramid& pyramid, double gain)
{
  // 16 bits hold a pixel times 256; the product keeps three bits of fraction, which are rounded away.
  const auto factor = static_cast<uint16_t>(std::lround(gain * 2048.0));
  auto* bytes = pyramid->hostAs<uint8_t>(pi_runtime::Access::READ_WRITE);
  const size_t count = pyramid->bytes();
  const cv::v_uint16x8 factors = cv::v_setall_u16(factor);
  size_t i = 0;
  for (; i + 16 <= count; i += 16)
  {
    cv::v_uint16x8 low;
    cv::v_uint16x8 high;
    cv::v_expand(cv::v_load(bytes + i), low, high);
    low = cv::v_mul_hi(cv::v_shl<8>(low), factors);
    high = cv::v_mul_hi(cv::v_shl<8>(high), factors);
    cv::v_store(bytes + i, cv::v_rshr_pack<3>(low, high));
  }
  for (; i < count; ++i)
  {
    const uint32_t eighths = (static_cast<uint32_t>(bytes[i]) << 8) * factor >> 16;
    bytes[i] = static_cast<uint8_t>(std::min<uint32_t>(255, (eighths + 4) >> 3));
  }
}

bool isBlank(const PictureStatistics& statistics)
{
  return statistics.contrast < LEAST_CONTRAST;
}

}  // namespace pi_slam::front_end
