#include <pi_runtime/kernels/orb.h>

#include <cmath>
#include <cstring>

#include "kernels/simd.h"

namespace pi_runtime
{
namespace kernels
{
namespace
{

constexpr int SIDE = 2 * ORB_RADIUS + 1;

struct Moments
{
  int m10;
  int m01;
};

/// First moments of the disc around a pixel; reads one column more than the disc has.
PI_RUNTIME_SIMD_CLONES
Moments momentsOf(const uint8_t* centre, ptrdiff_t stride, const OrbTables& tables)
{
  const uint8_t* row = centre - ORB_RADIUS * stride - ORB_RADIUS;
  Moments moments{0, 0};
  for (int y = 0; y < SIDE; ++y, row += stride)
  {
    int sum = 0;
    int weighted = 0;
    for (int x = 0; x < SIDE + 1; ++x)
    {
      sum += static_cast<int16_t>(row[x]) * tables.disc[y][x];
      weighted += static_cast<int16_t>(row[x]) * tables.column[y][x];
    }
    moments.m10 += weighted;
    moments.m01 += (y - ORB_RADIUS) * sum;
  }
  return moments;
}

/// Direction (m10, m01) as a multiple of 1 / 256 turn: within its octant by comparison with tangents, so that every
/// implementation gets the same one.
int angleOf(Moments moments, const OrbTables& tables)
{
  const int64_t ax = std::abs(static_cast<int64_t>(moments.m10));
  const int64_t ay = std::abs(static_cast<int64_t>(moments.m01));
  const int64_t low = ax < ay ? ax : ay;
  const int64_t high = ax < ay ? ay : ax;
  int angle = 0;
  for (int i = 0; i < ORB_ANGLES / 8; ++i)
  {
    angle += low * (1 << 14) > tables.octant[i] * high;
  }
  angle = ax < ay ? ORB_ANGLES / 4 - angle : angle;
  angle = moments.m10 < 0 ? ORB_ANGLES / 2 - angle : angle;
  return (moments.m01 < 0 ? ORB_ANGLES - angle : angle) % ORB_ANGLES;
}

PI_RUNTIME_SIMD_CLONES
void describe(const uint8_t* centre, int stride, const OrbTables& tables, int angle, uint8_t* descriptor)
{
  const int c = tables.cosine[angle];
  const int s = tables.sine[angle];
  int32_t offset[2 * ORB_BITS];
  for (int i = 0; i < 2 * ORB_BITS; ++i)
  {
    const int x = (tables.x[i] * c - tables.y[i] * s + (1 << 13)) >> 14;
    const int y = (tables.x[i] * s + tables.y[i] * c + (1 << 13)) >> 14;
    offset[i] = y * stride + x;
  }
  uint8_t level[2 * ORB_BITS];
  for (int i = 0; i < 2 * ORB_BITS; ++i)
  {
    level[i] = centre[offset[i]];
  }
  uint8_t darker[ORB_BITS];
  for (int i = 0; i < ORB_BITS; ++i)
  {
    darker[i] = level[i] < level[i + ORB_BITS] ? 1 : 0;
  }
  for (int i = 0; i < ORB_BYTES; ++i)
  {
    // Eight bytes of 0 or 1 to eight bits: byte k lands in bit 56 + k of the product.
    uint64_t eight;
    std::memcpy(&eight, darker + 8 * i, sizeof(eight));
    descriptor[i] = static_cast<uint8_t>(eight * 0x0102040810204080U >> 56);
  }
}

}  // namespace

void describeOrb(const ImageView<const uint8_t>& image, const ImageView<const uint8_t>& smoothed, const float* points,
                 const OrbTables& tables, size_t begin, size_t end, uint8_t* descriptors, uint16_t* angles)
{
  for (size_t i = begin; i < end; ++i)
  {
    const float x = std::nearbyint(points[2 * i]);
    const float y = std::nearbyint(points[2 * i + 1]);
    uint8_t* const descriptor = descriptors + i * ORB_BYTES;
    const bool inside = x >= ORB_BORDER && y >= ORB_BORDER && x < static_cast<float>(image.width - ORB_BORDER) &&
                        y < static_cast<float>(image.height - ORB_BORDER);
    if (!inside)
    {
      std::memset(descriptor, 0, ORB_BYTES);
      angles[i] = ORB_NO_ANGLE;
      continue;
    }
    const int column = static_cast<int>(x);
    const int row = static_cast<int>(y);
    const Moments moments = momentsOf(image.row(row) + column, static_cast<ptrdiff_t>(image.stride), tables);
    const int angle = angleOf(moments, tables);
    angles[i] = static_cast<uint16_t>(angle);
    describe(smoothed.row(row) + column, static_cast<int>(smoothed.stride), tables, angle, descriptor);
  }
}

}  // namespace kernels
}  // namespace pi_runtime
