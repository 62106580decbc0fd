#include "kernels/rectify.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

#include "kernels/simd.h"

namespace pi_runtime
{
namespace kernels
{
namespace
{

constexpr int FRACTIONS = 1 << REMAP_FRACTION_BITS;
constexpr int BLOCK = 64;  ///< pixels whose neighbours are collected before they are weighted

struct Point
{
  double x;
  double y;
};

Point distortRadtan(const std::array<double, 5>& d, double x, double y)
{
  const double r2 = x * x + y * y;
  const double radial = 1.0 + ((d[4] * r2 + d[1]) * r2 + d[0]) * r2;
  return {x * radial + d[2] * 2.0 * x * y + d[3] * (r2 + 2.0 * x * x),
          y * radial + d[2] * (r2 + 2.0 * y * y) + d[3] * 2.0 * x * y};
}

Point distortEquidistant(const std::array<double, 5>& d, double x, double y)
{
  const double r = std::sqrt(x * x + y * y);
  const double theta = std::atan(r);
  const double t2 = theta * theta;
  const double theta_d = theta * (1.0 + t2 * (d[0] + t2 * (d[1] + t2 * (d[2] + t2 * d[3]))));
  const double scale = r == 0.0 ? 1.0 : theta_d / r;
  return {x * scale, y * scale};
}

/// Position in 32nds of a pixel, kept within what int16 pixels can say.
int toFixed(double position)
{
  const double low = static_cast<double>(INT16_MIN) * FRACTIONS;
  const double high = static_cast<double>(INT16_MAX) * FRACTIONS;
  return static_cast<int>(std::lrint(std::min(std::max(position * FRACTIONS, low), high)));
}

void requireFocalLength(const char* name, double value)
{
  if (!(value > 0.0) || !std::isfinite(value))
  {
    throw std::invalid_argument(std::string("buildRemapTable: ") + name + " = " + std::to_string(value) +
                                ", must be positive and finite");
  }
}

struct Source
{
  const uint8_t* data;
  int width;
  int height;
  int stride;
};

/// One pixel with neighbours outside the source: those count as 0.
inline uint8_t guardedPixel(const Source& source, int channels, int channel, int x, int y, unsigned fraction)
{
  const int ax = static_cast<int>(fraction) & (FRACTIONS - 1);
  const int ay = static_cast<int>(fraction) >> REMAP_FRACTION_BITS & (FRACTIONS - 1);
  const auto at = [&](int px, int py) -> int
  {
    const bool inside = px >= 0 && py >= 0 && px < source.width && py < source.height;
    return inside ? source.data[static_cast<ptrdiff_t>(py) * source.stride + px * channels + channel] : 0;
  };
  const int top = at(x, y) * (FRACTIONS - ax) + at(x + 1, y) * ax;
  const int bottom = at(x, y + 1) * (FRACTIONS - ax) + at(x + 1, y + 1) * ax;
  return static_cast<uint8_t>((top * (FRACTIONS - ay) + bottom * ay + 512) >> 10);
}

inline void guardedBlock(const Source& source, int channels, const int16_t* xy, const uint16_t* fraction, int count,
                         uint8_t* out)
{
  for (int i = 0; i < count; ++i)
  {
    for (int channel = 0; channel < channels; ++channel)
    {
      out[i * channels + channel] = guardedPixel(source, channels, channel, xy[2 * i], xy[2 * i + 1], fraction[i]);
    }
  }
}

/// Offsets of the upper left neighbours.
/// @param margin  columns right of x that are read as well
/// @return false if a pixel of the block reads outside the source
inline bool blockOffsets(const Source& source, int channels, int margin, const int16_t* xy, int* offset)
{
  const unsigned columns = static_cast<unsigned>(std::max(source.width - margin, 0));
  const unsigned rows = static_cast<unsigned>(source.height - 1);
  unsigned outside = 0;
  for (int i = 0; i < BLOCK; ++i)
  {
    int32_t point;  // read as one: deinterleaving int16 costs more
    std::memcpy(&point, xy + 2 * i, sizeof(point));
    const int x = static_cast<int16_t>(point & 0xFFFF);
    const int y = point >> 16;
    outside |= static_cast<unsigned>(static_cast<unsigned>(x) >= columns) |
               static_cast<unsigned>(static_cast<unsigned>(y) >= rows);
    offset[i] = y * source.stride + x * channels;
  }
  return outside == 0;
}

PI_RUNTIME_SIMD_CLONES
void remapRow1(const Source& source, const int16_t* xy, const uint16_t* fraction, int width, uint8_t* out)
{
  int x = 0;
  for (; x + BLOCK <= width; x += BLOCK)
  {
    int offset[BLOCK];
    if (!blockOffsets(source, 1, 1, xy + 2 * x, offset))
    {
      guardedBlock(source, 1, xy + 2 * x, fraction + x, BLOCK, out + x);
      continue;
    }
    uint8_t top[2 * BLOCK];
    uint8_t bottom[2 * BLOCK];
    for (int i = 0; i < BLOCK; ++i)
    {
      std::memcpy(top + 2 * i, source.data + offset[i], 2);
      std::memcpy(bottom + 2 * i, source.data + offset[i] + source.stride, 2);
    }
    for (int i = 0; i < BLOCK; ++i)
    {
      const int ax = fraction[x + i] & (FRACTIONS - 1);
      const int ay = fraction[x + i] >> REMAP_FRACTION_BITS;
      const int upper = top[2 * i] * (FRACTIONS - ax) + top[2 * i + 1] * ax;
      const int lower = bottom[2 * i] * (FRACTIONS - ax) + bottom[2 * i + 1] * ax;
      out[x + i] = static_cast<uint8_t>((upper * (FRACTIONS - ay) + lower * ay + 512) >> 10);
    }
  }
  guardedBlock(source, 1, xy + 2 * x, fraction + x, width - x, out + x);
}

typedef uint8_t Bytes16 __attribute__((vector_size(16)));
typedef uint16_t Words8 __attribute__((vector_size(16)));
typedef uint32_t Ints4 __attribute__((vector_size(16)));

/// Eight bytes, widened. By a shuffle with zeros, as GCC 12 converts vectors in halves.
inline Words8 loadWords8(const uint8_t* at)
{
  Bytes16 bytes{};
  std::memcpy(&bytes, at, 8);
  return reinterpret_cast<Words8>(
      __builtin_shufflevector(bytes, Bytes16{}, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23));
}

/// Two neighbours lie in eight bytes, b g r b g r and two that are not used. Writes four bytes, the last one unused.
inline void blend3(const uint8_t* at, int stride, unsigned fraction, uint8_t* out)
{
  const unsigned ax = fraction & (FRACTIONS - 1);
  const unsigned ay = fraction >> REMAP_FRACTION_BITS;
  const Words8 column =
      loadWords8(at) * static_cast<uint16_t>(FRACTIONS - ay) + loadWords8(at + stride) * static_cast<uint16_t>(ay);
  const auto left = reinterpret_cast<Ints4>(__builtin_shufflevector(column, Words8{}, 0, 8, 1, 8, 2, 8, 2, 8));
  const auto right = reinterpret_cast<Ints4>(__builtin_shufflevector(column, Words8{}, 3, 8, 4, 8, 5, 8, 5, 8));
  const Ints4 sum = (left * (FRACTIONS - ax) + right * ax + 512U) >> 10U;
  const auto bytes = reinterpret_cast<Bytes16>(sum);
  const Bytes16 pixel = __builtin_shufflevector(bytes, bytes, 0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12, 0, 4, 8, 12);
  std::memcpy(out, &pixel, 4);
}

/// Three channels: the six bytes of two neighbours lie in one 8-byte word, which may not pass the end of the row.
PI_RUNTIME_SIMD_CLONES
void remapRow3(const Source& source, const int16_t* xy, const uint16_t* fraction, int width, uint8_t* out)
{
  int x = 0;
  for (; x + BLOCK <= width; x += BLOCK)
  {
    int offset[BLOCK];
    if (!blockOffsets(source, 3, 2, xy + 2 * x, offset))
    {
      guardedBlock(source, 3, xy + 2 * x, fraction + x, BLOCK, out + 3 * x);
      continue;
    }
    uint8_t block[3 * BLOCK + 1];
    for (int i = 0; i < BLOCK; ++i)
    {
      blend3(source.data + offset[i], source.stride, fraction[x + i], block + 3 * i);
    }
    std::memcpy(out + 3 * x, block, 3 * BLOCK);
  }
  guardedBlock(source, 3, xy + 2 * x, fraction + x, width - x, out + 3 * x);
}

}  // namespace

void buildRemapTable(const CameraIntrinsics& camera, const RectifiedCamera& rectified, int width, int height,
                     int16_t* xy, uint16_t* fraction)
{
  if (width <= 0 || height <= 0)
  {
    throw std::invalid_argument("buildRemapTable: size " + std::to_string(width) + " x " + std::to_string(height) +
                                ", must be positive");
  }
  requireFocalLength("camera.fx", camera.fx);
  requireFocalLength("camera.fy", camera.fy);
  requireFocalLength("rectified.fx", rectified.fx);
  requireFocalLength("rectified.fy", rectified.fy);
  const std::array<double, 9>& R = rectified.R_rect_cam;
  for (int v = 0; v < height; ++v)
  {
    for (int u = 0; u < width; ++u, xy += 2, ++fraction)
    {
      // The ray of the rectified pixel, seen from the real camera: R^T times the normalised point.
      const double a = (u - rectified.cx) / rectified.fx;
      const double b = (v - rectified.cy) / rectified.fy;
      const double z = R[2] * a + R[5] * b + R[8];
      if (!(z > 0.0))
      {
        xy[0] = xy[1] = INT16_MIN;
        *fraction = 0;
        continue;
      }
      const double x = (R[0] * a + R[3] * b + R[6]) / z;
      const double y = (R[1] * a + R[4] * b + R[7]) / z;
      const Point bent = camera.model == LensModel::RADTAN ? distortRadtan(camera.distortion, x, y)
                                                           : distortEquidistant(camera.distortion, x, y);
      const int fixed_x = toFixed(camera.fx * bent.x + camera.cx);
      const int fixed_y = toFixed(camera.fy * bent.y + camera.cy);
      xy[0] = static_cast<int16_t>(fixed_x >> REMAP_FRACTION_BITS);
      xy[1] = static_cast<int16_t>(fixed_y >> REMAP_FRACTION_BITS);
      *fraction =
          static_cast<uint16_t>((fixed_y & (FRACTIONS - 1)) << REMAP_FRACTION_BITS | (fixed_x & (FRACTIONS - 1)));
    }
  }
}

void remap(const ImageView<const uint8_t>& source, const int16_t* xy, const uint16_t* fraction,
           const ImageView<uint8_t>& destination, int begin, int end)
{
  const Source from{source.data, source.width, source.height, static_cast<int>(source.stride)};
  const auto row = source.channels == 1 ? remapRow1 : remapRow3;
  for (int y = begin; y < end; ++y)
  {
    const size_t first = static_cast<size_t>(y) * destination.width;
    row(from, xy + 2 * first, fraction + first, destination.width, destination.row(y));
  }
}

}  // namespace kernels
}  // namespace pi_runtime
