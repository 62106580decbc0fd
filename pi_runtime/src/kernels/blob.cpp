#include <pi_runtime/kernels/blob.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "kernels/codelet_arguments.h"
#include "kernels/simd.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr char NAME[] = "blob";
constexpr int COLUMN_STEP = 16;  ///< columns of the plan are padded to this
constexpr float WEIGHT_ONE = 2048.0F;

size_t planColumns(const BlobGeometry& geometry)
{
  return roundUp(static_cast<size_t>(geometry.width), COLUMN_STEP);
}

/// Source position of destination pixel i of `count`, as cv::resize computes it.
float sourcePosition(int i, int count, int source_count)
{
  const double scale = 1.0 / (static_cast<double>(count) / source_count);
  return static_cast<float>((i + 0.5) * scale - 0.5);
}

int32_t packWeights(float fraction)
{
  const auto first = static_cast<int32_t>(std::lrint((1.0F - fraction) * WEIGHT_ONE));
  const auto second = static_cast<int32_t>(std::lrint(fraction * WEIGHT_ONE));
  return second << 16 | first;
}

/// @param[out] offset, weights  of one column of the picture
void planColumn(int i, int count, int source_count, int channels, int32_t* offset, int32_t* weights)
{
  const float position = sourcePosition(i, count, source_count);
  const int left = static_cast<int>(std::floor(position));
  if (left < 0)
  {
    *offset = 0;
    *weights = packWeights(0.0F);
  }
  else if (left >= source_count - 1)
  {
    // The last pixel alone; it comes as the right one of a pair, so that pairs never pass the end of the row.
    *offset = (source_count - 2) * channels;
    *weights = packWeights(1.0F);
  }
  else
  {
    *offset = left * channels;
    *weights = packWeights(position - static_cast<float>(left));
  }
}

void planRow(int i, int count, int source_count, int32_t* upper, int32_t* lower, int32_t* weights)
{
  const float position = sourcePosition(i, count, source_count);
  const int above = static_cast<int>(std::floor(position));
  *upper = std::min(std::max(above, 0), source_count - 1);
  *lower = std::min(std::max(above + 1, 0), source_count - 1);
  *weights = packWeights(position - static_cast<float>(above));
}

struct Plan
{
  Plan(const int32_t* plan, const BlobGeometry& geometry)
    : offsets(plan)
    , column_weights(offsets + planColumns(geometry))
    , upper(column_weights + planColumns(geometry))
    , lower(upper + geometry.height)
    , row_weights(lower + geometry.height)
  {
  }
  const int32_t* offsets;
  const int32_t* column_weights;
  const int32_t* upper;
  const int32_t* lower;
  const int32_t* row_weights;
};

/// One source row at the destination's columns, in 128ths of a grey level, one plane per channel.
/// @param columns  a multiple of COLUMN_STEP
PI_RUNTIME_SIMD_CLONES
void stretchRow3(const uint8_t* __restrict row, const int32_t* __restrict offsets, const int32_t* __restrict weights,
                 int columns, int16_t* __restrict out)
{
  for (int x = 0; x < columns; x += COLUMN_STEP)
  {
    uint32_t left[COLUMN_STEP];   // b g r, and the next pixel's b
    uint32_t right[COLUMN_STEP];  // the first pixel's r, then b g r
    for (int i = 0; i < COLUMN_STEP; ++i)
    {
      std::memcpy(left + i, row + offsets[x + i], 4);
      std::memcpy(right + i, row + offsets[x + i] + 2, 4);
    }
    for (int i = 0; i < COLUMN_STEP; ++i)
    {
      const int first = weights[x + i] & 0xFFFF;
      const int second = weights[x + i] >> 16;
      for (int channel = 0; channel < 3; ++channel)
      {
        const int a = left[i] >> (8 * channel) & 0xFF;
        const int b = right[i] >> (8 * channel + 8) & 0xFF;
        out[channel * columns + x + i] = static_cast<int16_t>((a * first + b * second) >> 4);
      }
    }
  }
}

PI_RUNTIME_SIMD_CLONES
void stretchRow1(const uint8_t* __restrict row, const int32_t* __restrict offsets, const int32_t* __restrict weights,
                 int columns, int16_t* __restrict out)
{
  for (int x = 0; x < columns; x += COLUMN_STEP)
  {
    uint16_t pair[COLUMN_STEP];
    for (int i = 0; i < COLUMN_STEP; ++i)
    {
      std::memcpy(pair + i, row + offsets[x + i], 2);
    }
    for (int i = 0; i < COLUMN_STEP; ++i)
    {
      const int sum = (pair[i] & 0xFF) * (weights[x + i] & 0xFFFF) + (pair[i] >> 8) * (weights[x + i] >> 16);
      out[x + i] = static_cast<int16_t>(sum >> 4);
    }
  }
}

/// Two stretched rows to grey levels.
PI_RUNTIME_SIMD_CLONES
void blendRows(const int16_t* __restrict upper, const int16_t* __restrict lower, int32_t weights, int count,
               uint8_t* __restrict out)
{
  const auto first = static_cast<int16_t>(weights & 0xFFFF);
  const auto second = static_cast<int16_t>(weights >> 16);
  for (int i = 0; i < count; ++i)
  {
    const auto a = static_cast<int16_t>(upper[i] * first >> 16);
    const auto b = static_cast<int16_t>(lower[i] * second >> 16);
    out[i] = static_cast<uint8_t>((a + b + 2) >> 2);
  }
}

/// No product is added to anything here, so fused multiply-add cannot change the result.
PI_RUNTIME_SIMD_CLONES
void normalise(const uint8_t* __restrict levels, int count, float mean, float scale, float* __restrict out)
{
  for (int i = 0; i < count; ++i)
  {
    out[i] = (static_cast<float>(levels[i]) - mean) * scale;
  }
}

class RowMaker
{
public:
  RowMaker(const uint8_t* source, const int32_t* plan, const BlobGeometry& geometry, const BlobColours& colours)
    : source_(source)
    , plan_(plan, geometry)
    , geometry_(geometry)
    , content_(blobContent(geometry))
    , colours_(colours)
    , columns_(static_cast<int>(planColumns(geometry)))
    , stretched_{std::vector<int16_t>(columns_ * geometry.channels), std::vector<int16_t>(columns_ * geometry.channels)}
    , levels_(columns_ * geometry.channels)
  {
  }

  void make(int y, float* destination)
  {
    const auto fill = static_cast<uint8_t>(colours_.fill);
    if (y < content_.y || y >= content_.y + content_.height)
    {
      std::fill(levels_.begin(), levels_.end(), fill);
    }
    else
    {
      const int16_t* const upper = stretched(plan_.upper[y]);
      const int16_t* const lower = stretched(plan_.lower[y]);
      blendRows(upper, lower, plan_.row_weights[y], columns_ * geometry_.channels, levels_.data());
      for (int channel = 0; channel < geometry_.channels && content_.width < geometry_.width; ++channel)
      {
        uint8_t* const plane = levels_.data() + channel * columns_;
        std::fill(plane, plane + content_.x, fill);
        std::fill(plane + content_.x + content_.width, plane + geometry_.width, fill);
      }
    }
    store(y, destination);
  }

private:
  /// Kept for the next row, which often needs one of the two again.
  const int16_t* stretched(int row)
  {
    if (rows_[0] == row || rows_[1] == row)
    {
      newest_ = rows_[0] == row ? 0 : 1;
      return stretched_[newest_].data();
    }
    newest_ = 1 - newest_;
    rows_[newest_] = row;
    const uint8_t* const from = source_ + static_cast<size_t>(row) * geometry_.source_stride;
    const auto stretch = geometry_.channels == 3 ? stretchRow3 : stretchRow1;
    stretch(from, plan_.offsets, plan_.column_weights, columns_, stretched_[newest_].data());
    return stretched_[newest_].data();
  }

  void store(int y, float* destination) const
  {
    for (int plane = 0; plane < geometry_.channels; ++plane)
    {
      const int channel = colours_.swap_rb != 0 ? geometry_.channels - 1 - plane : plane;
      const uint8_t* const levels = levels_.data() + channel * columns_;
      const size_t first = (static_cast<size_t>(plane) * geometry_.height + y) * geometry_.width;
      normalise(levels, geometry_.width, colours_.mean[plane], colours_.scale[plane], destination + first);
    }
  }

  const uint8_t* const source_;
  const Plan plan_;
  const BlobGeometry geometry_;
  const BlobContent content_;
  const BlobColours colours_;
  const int columns_;
  std::array<std::vector<int16_t>, 2> stretched_;
  std::array<int, 2> rows_{-1, -1};
  int newest_ = 1;
  std::vector<uint8_t> levels_;
};

}  // namespace

BlobContent blobContent(const BlobGeometry& geometry)
{
  if (geometry.letterbox == BLOB_STRETCHED)
  {
    return {0, 0, geometry.width, geometry.height};
  }
  const int64_t sw = geometry.source_width;
  const int64_t sh = geometry.source_height;
  const bool centred = geometry.letterbox == BLOB_CENTRED;
  const auto part = [centred](int64_t side, int64_t numerator, int64_t denominator)
  {
    const int64_t rounding = centred ? denominator / 2 : 0;
    return static_cast<int32_t>(std::max<int64_t>(1, (side * numerator + rounding) / denominator));
  };
  BlobContent content{0, 0, geometry.width, geometry.height};
  if (geometry.width * sh <= geometry.height * sw)
  {
    content.height = part(sh, geometry.width, sw);
  }
  else
  {
    content.width = part(sw, geometry.height, sh);
  }
  if (!centred)
  {
    return content;
  }
  content.x = (geometry.width - content.width) / 2;
  content.y = (geometry.height - content.height) / 2;
  return content;
}

size_t blobPlanBytes(const BlobGeometry& geometry)
{
  return (2 * planColumns(geometry) + 3 * static_cast<size_t>(geometry.height)) * sizeof(int32_t);
}

BufferPtr makeBlobPlan(const BlobGeometry& geometry)
{
  requireBetween(NAME, "source_width", geometry.source_width, 2, INT16_MAX);
  requireBetween(NAME, "source_height", geometry.source_height, 1, INT16_MAX);
  requireBetween(NAME, "width", geometry.width, 1, INT16_MAX);
  requireBetween(NAME, "height", geometry.height, 1, INT16_MAX);
  const BufferPtr buffer = Buffer::allocate(blobPlanBytes(geometry));
  auto* const offsets = buffer->hostAs<int32_t>(Access::WRITE);
  int32_t* const column_weights = offsets + planColumns(geometry);
  int32_t* const upper = column_weights + planColumns(geometry);
  const BlobContent content = blobContent(geometry);
  for (int x = 0; x < content.width; ++x)
  {
    planColumn(x, content.width, geometry.source_width, geometry.channels, offsets + content.x + x,
               column_weights + content.x + x);
  }
  for (int y = 0; y < content.height; ++y)
  {
    int32_t* const entry = upper + content.y + y;
    planRow(y, content.height, geometry.source_height, entry, entry + geometry.height, entry + 2 * geometry.height);
  }
  return buffer;
}

void makeBlob(const uint8_t* source, const int32_t* plan, const BlobGeometry& geometry, const BlobColours& colours,
              int begin, int end, float* destination)
{
  RowMaker maker(source, plan, geometry, colours);
  for (int y = begin; y < end; ++y)
  {
    maker.make(y, destination);
  }
}

}  // namespace pi_runtime::kernels
