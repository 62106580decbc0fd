#pragma once

#include <cstddef>
#include <cstdint>

#include <pi_runtime/codelet.h>

namespace pi_runtime::kernels
{

constexpr int HAMMING_BYTES = 32;       ///< per descriptor: 256 bits
constexpr int HAMMING_MOST = 1 << 22;   ///< descriptors per set, at most
constexpr int32_t HAMMING_NOBODY = -1;  ///< index where there is no match
constexpr int32_t HAMMING_FAR = 257;    ///< distance where there is no match

/// The two nearest train descriptors of a query: by distance, ties by index.
struct HammingMatch
{
  int32_t best;             ///< index of the nearest one, or HAMMING_NOBODY
  int32_t second;           ///< of the next one, or HAMMING_NOBODY
  int32_t best_distance;    ///< bits that differ, 0 to 256, or HAMMING_FAR
  int32_t second_distance;  ///< likewise
};

/// Argument 3 of hammingCodelet().
struct HammingShape
{
  int32_t queries;  ///< 0 to HAMMING_MOST
  int32_t trains;   ///< 0 to HAMMING_MOST
};

/// Compares each query with each train descriptor, as cv::BFMatcher(NORM_HAMMING)::knnMatch(k = 2).
/// @param matches     one per query
/// @param begin, end  queries to match
void matchHamming(const uint8_t* queries, const uint8_t* trains, const HammingShape& shape, size_t begin, size_t end,
                  HammingMatch* matches);

/// "hamming": matchHamming() above. Range: queries; sliceable. Both implementations give the same bits.
///   0 in   queries, uint8, HAMMING_BYTES each
///   1 in   trains, uint8, HAMMING_BYTES each
///   2 out  HammingMatch per query
///   3      HammingShape
/// A set without descriptors still needs a buffer of at least one byte.
CodeletPtr hammingCodelet();

}  // namespace pi_runtime::kernels
