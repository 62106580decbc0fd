#pragma once

#include <cstddef>
#include <cstdint>

#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/image_view.h>

namespace pi_runtime
{
namespace kernels
{

constexpr int ORB_BITS = 256;
constexpr int ORB_BYTES = ORB_BITS / 8;
constexpr int ORB_ANGLES = 256;         ///< orientations are multiples of 1 / 256 turn
constexpr int ORB_RADIUS = 15;          ///< of the disc that gives the orientation [px]
constexpr int ORB_TEST_RADIUS = 18;     ///< of the disc that tests look at [px]
constexpr int ORB_BORDER = 19;          ///< points nearer to the border than this have no descriptor [px]
constexpr uint16_t ORB_NO_ANGLE = 256;  ///< orientation of points without a descriptor

/// What descriptors are made with. Test i compares the pixels at (x[i], y[i]) and (x[i + 256], y[i + 256]).
struct OrbTables
{
  int16_t x[2 * ORB_BITS];         ///< [px], within ORB_TEST_RADIUS of the point
  int16_t y[2 * ORB_BITS];         ///< [px]
  int16_t cosine[ORB_ANGLES];      ///< times 2^14
  int16_t sine[ORB_ANGLES];        ///< times 2^14
  int16_t column[31][32];          ///< x - 15 where pixel x of row y lies in the disc, else 0
  int16_t disc[31][32];            ///< 1 where it lies in the disc, else 0
  int32_t octant[ORB_ANGLES / 8];  ///< tangents of the angles between two orientations, times 2^14
};

/// The tables of this library, always the same ones: read-only, for argument 3 of the codelet.
///
/// The tests are not learned from pictures as those of Rublee et al. 2011 are, but chosen for the same aims with a
/// model of pictures: grey levels as a stationary random field, the correlation of two pixels d apart being 1 / (1 +
/// d^2 / 49 px^2). Candidates are drawn as BRIEF does (Calonder et al. 2010; here normal with sigma 10 px, within the
/// disc, the pixels of a test at least 6 px apart), from a fixed seed. A candidate is taken if its correlation with
/// every test taken before is below a bound, and that with the moment m10, which turns the patch and so makes outcomes
/// predictable, below 2/5 of it; the bound rises until 256 are found. Computed at the first call (some 20 ms), in
/// integers or far from rounding limits, so that each machine gets the same tests.
const OrbTables& orbTables();
BufferPtr orbTablesBuffer();

/// Oriented BRIEF (Rublee et al. 2011): orientation by the intensity centroid of a disc, rounded to 1 / 256 turn; 256
/// tests of the smoothed image, turned by it and rounded to whole pixels. Bit i % 8 of byte i / 8 is test i: set if the
/// first pixel is darker.
/// @param image     8 bit, one channel
/// @param smoothed  same size, as gaussianBlur7() makes it
/// @param points    x and y of each point [px], rounded to the nearest pixel, ties to even. Points nearer than
///                  ORB_BORDER to the border (or not finite) get a descriptor of zeros and ORB_NO_ANGLE.
/// @param[out] descriptors  ORB_BYTES per point
/// @param[out] angles       one per point [1 / 256 turn], counted from x to y
/// @param begin, end        points to describe
void describeOrb(const ImageView<const uint8_t>& image, const ImageView<const uint8_t>& smoothed, const float* points,
                 const OrbTables& tables, size_t begin, size_t end, uint8_t* descriptors, uint16_t* angles);

/// Argument 6 of the codelet. Strides in bytes.
struct OrbShape
{
  int32_t width;
  int32_t height;
  int32_t image_stride;
  int32_t smoothed_stride;
  int32_t points;
};

/// "orb": describeOrb() above. Range: points; sliceable. Both implementations give the same bits.
///   0 in   image, uint8
///   1 in   smoothed image, uint8
///   2 in   points, float, 2 * points
///   3 in   orbTablesBuffer()
///   4 out  descriptors, uint8, ORB_BYTES * points
///   5 out  angles, uint16, points
///   6      OrbShape
CodeletPtr orbCodelet();

}  // namespace kernels
}  // namespace pi_runtime
