#pragma once

#include <cstdint>
#include <limits>

/// What tests of several files count in.
namespace pi_vehicle
{

inline constexpr int64_t MS = 1'000'000;          ///< [ns]
inline constexpr int64_t SECOND = 1'000'000'000;  ///< [ns]
inline constexpr double NaN = std::numeric_limits<double>::quiet_NaN();

}  // namespace pi_vehicle
