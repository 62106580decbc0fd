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

/// Argument 5 of hammingCodelet(): sizes, and which pairs count.
struct HammingShape
{
  int32_t queries;      ///< 0 to HAMMING_MOST
  int32_t trains;       ///< 0 to HAMMING_MOST
  int32_t use_window;   ///< 0: all pairs; 1: those that fulfil the three bounds
  float max_rows;       ///< |y of query - y of train| is at most this [px]
  float min_disparity;  ///< x of query - x of train is at least this [px]
  float max_disparity;  ///< and at most this [px]
};

/// Compares each query with each train descriptor. As cv::BFMatcher(NORM_HAMMING)::knnMatch(k = 2) if there is no
/// window; with one, the search along the rows of a rectified stereo pair (left image: queries).
/// @param query_positions, train_positions  x and y of each [px]; not read without a window
/// @param matches     one per query
/// @param begin, end  queries to match
void matchHamming(const uint8_t* queries, const uint8_t* trains, const float* query_positions,
                  const float* train_positions, const HammingShape& shape, size_t begin, size_t end,
                  HammingMatch* matches);

/// "hamming": matchHamming() above. Range: queries; sliceable. Both implementations give the same bits.
///   0 in   queries, uint8, HAMMING_BYTES each
///   1 in   trains, uint8, HAMMING_BYTES each
///   2 in   positions of the queries, float x, y (without a window any buffer)
///   3 in   positions of the trains, likewise
///   4 out  HammingMatch per query
///   5      HammingShape
/// A set without descriptors still needs a buffer of at least one byte.
CodeletPtr hammingCodelet();

}  // namespace pi_runtime::kernels
