#pragma once

#include <cmath>
#include <cstdint>

namespace pi_offload::simulation
{

/// Random numbers as a function of seed, purpose and indices, independent of earlier draws. SplitMix64 (Steele, Lea,
/// Flood 2014) over a hash of the key.
class HashRandom
{
public:
  template <typename... Keys>
  explicit HashRandom(uint32_t seed, Keys... keys) : state_(mix(seed + 0x9E3779B97F4A7C15ULL))
  {
    ((state_ = mix(state_ ^ (static_cast<uint64_t>(keys) + 0x9E3779B97F4A7C15ULL))), ...);
  }

  uint64_t next()
  {
    state_ += 0x9E3779B97F4A7C15ULL;
    return mix(state_);
  }
  /// In (0, 1).
  double uniform() { return (static_cast<double>(next() >> 11U) + 0.5) * 0x1.0p-53; }
  double exponential(double mean) { return -mean * std::log(uniform()); }
  double normal()
  {
    const double radius = std::sqrt(-2.0 * std::log(uniform()));
    return radius * std::cos(2.0 * M_PI * uniform());
  }
  /// Of mean 1. @param deviation  standard deviation of the logarithm
  double logNormal(double deviation) { return std::exp(deviation * normal() - 0.5 * deviation * deviation); }

private:
  static uint64_t mix(uint64_t z)
  {
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31U);
  }

  uint64_t state_;
};

}  // namespace pi_offload::simulation
