#pragma once

#include <cstdint>

namespace pi_slam
{

/// Of the motions in tests.
constexpr int64_t START_NS = 1700000000000000000LL;

}  // namespace pi_slam
