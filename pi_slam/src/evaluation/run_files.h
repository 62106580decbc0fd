#pragma once

#include "evaluation/sequence_run.h"

#include <string>
#include <vector>

namespace pi_slam
{

/// Writes poses as a TUM file: t x y z qx qy qz qw, seconds with nine decimals.
/// @param comment  first line, without the hash.
/// @throws std::runtime_error if the file cannot be written.
void writeTum(const std::string& file, const std::string& comment, const std::vector<StampedPose>& poses);

/// Writes one line per pair: status, counts and milliseconds per stage, comma-separated, with a heading.
/// @throws std::runtime_error if the file cannot be written.
void writeTiming(const std::string& file, const std::vector<PairRecord>& pairs);

/// @throws std::runtime_error if a file of this name cannot be written; leaves an existing one as it is.
void requireWritable(const std::string& file);

}  // namespace pi_slam
