#include "tracking/box_look.h"

#include <algorithm>
#include <cmath>

namespace pi_detect
{
namespace
{

constexpr float SIDE = 0.2F;  // of the box at left and right that mostly shows the background
constexpr int COLUMNS = 12;   // samples of a box at most; more do not change the histogram
constexpr int ROWS = 32;
constexpr int HALVES = 2;
constexpr int COLOUR_BITS = 2;  // 4 levels per channel, 64 colours
constexpr int COLOURS = 1 << (3 * COLOUR_BITS);
constexpr int GREYS = 16;

int binOf(const PictureView& picture, int x, int y)
{
  const bool grey = picture.format == PictureView::Format::MONO8;
  const uint8_t* pixel =
      picture.data + static_cast<size_t>(y) * picture.stride + static_cast<size_t>(x) * (grey ? 1 : 3);
  if (grey)
  {
    return *pixel * GREYS / 256;
  }
  const int shift = 8 - COLOUR_BITS;
  return ((pixel[0] >> shift) << (2 * COLOUR_BITS)) | ((pixel[1] >> shift) << COLOUR_BITS) | (pixel[2] >> shift);
}

}  // namespace

BoxLook::BoxLook(const PictureView& picture, const Box& box)
{
  const float side = SIDE * box.width();
  const float x1 = std::max(0.0F, box.x1 + side);
  const float y1 = std::max(0.0F, box.y1);
  const float x2 = std::min(static_cast<float>(picture.width), box.x2 - side);
  const float y2 = std::min(static_cast<float>(picture.height), box.y2);
  if (!(x1 < x2 && y1 < y2))
  {
    return;
  }
  const int bins = picture.format == PictureView::Format::MONO8 ? GREYS : COLOURS;
  histogram_.assign(static_cast<size_t>(HALVES * bins), 0.0F);
  const float middle = 0.5F * (box.y1 + box.y2);
  const int columns = std::clamp(static_cast<int>(x2 - x1), 1, COLUMNS);
  const int rows = std::clamp(static_cast<int>(y2 - y1), 1, ROWS);
  const float weight = 1.0F / static_cast<float>(rows * columns);
  for (int row = 0; row < rows; ++row)
  {
    const float y = y1 + (static_cast<float>(row) + 0.5F) / static_cast<float>(rows) * (y2 - y1);
    const int first = y < middle ? 0 : bins;
    for (int column = 0; column < columns; ++column)
    {
      const float x = x1 + (static_cast<float>(column) + 0.5F) / static_cast<float>(columns) * (x2 - x1);
      histogram_[static_cast<size_t>(first + binOf(picture, static_cast<int>(x), static_cast<int>(y)))] += weight;
    }
  }
}

double BoxLook::similarity(const BoxLook& other) const
{
  if (histogram_.empty() || histogram_.size() != other.histogram_.size())
  {
    return 1.0;
  }
  double sum = 0.0;
  for (size_t i = 0; i < histogram_.size(); ++i)
  {
    sum += std::sqrt(static_cast<double>(histogram_[i]) * other.histogram_[i]);
  }
  return sum;
}

void BoxLook::blend(const BoxLook& seen, float part)
{
  if (seen.histogram_.empty())
  {
    return;
  }
  if (histogram_.size() != seen.histogram_.size())
  {
    histogram_ = seen.histogram_;
    return;
  }
  for (size_t i = 0; i < histogram_.size(); ++i)
  {
    histogram_[i] += part * (seen.histogram_[i] - histogram_[i]);
  }
}

}  // namespace pi_detect
