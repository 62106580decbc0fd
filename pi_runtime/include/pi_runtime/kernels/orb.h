#pragma once

#include <cstdint>

namespace pi_runtime::kernels
{

constexpr int ORB_BITS = 256;
constexpr int ORB_BYTES = ORB_BITS / 8;
constexpr int ORB_TEST_RADIUS = 18;  ///< of the disc that holds all pixels of the tests [px]

/// The tests of an oriented BRIEF descriptor (Rublee et al. 2011). Test i compares the pixels (x[i], y[i]) and
/// (x[i + 256], y[i + 256]) of the smoothed image, relative to the point; the bit is set if the first one is darker.
///
/// The tests were not learned from pictures, but chosen by a model of pictures: grey levels are a stationary random
/// field, in which two pixels at distance d have the correlation 1 / (1 + d^2 / 49 px^2). Candidates are drawn as
/// BRIEF does (Calonder et al. 2010): normal with sigma 10 px, within the disc, the two pixels at least 6 px apart. A
/// candidate is taken if its correlation with every test taken before is below a bound, and its correlation with the
/// moment m10 below 2/5 of the bound: m10 gives the orientation, so such a test would be predictable. The bound rises
/// until 256 tests are found. test_kernel_orb repeats the search.
struct OrbPattern
{
  int16_t x[2 * ORB_BITS];  ///< [px]
  int16_t y[2 * ORB_BITS];  ///< [px]
};

extern const OrbPattern ORB_PATTERN;

}  // namespace pi_runtime::kernels
