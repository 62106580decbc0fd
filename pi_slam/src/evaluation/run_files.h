#pragma once

#include "evaluation/run_report.h"

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

/// Writes what plot_run draws: the poses after each pair and, with a map, of its keyframes. With ground truth, the
/// poses are aligned to it by SE3, and their errors follow. Comma-separated rows; ns, m and rad:
///   name,RECORDING
///   pairs,N and poses,N
///   path_m,X and se3_rmse_m,X and yaw_rmse_m,X and rotation_rmse_rad,X: with ground truth
///   truth,STAMP,X,Y,Z: likewise
///   trajectory,NAME
///   pose,STAMP,X,Y,Z,HEADING: of the trajectory before
///   error,STAMP,POSITION,ROTATION: likewise
///   span,STATUS,FROM,TO: not for the status tracking
/// @param judged  at least one; the first holds the poses after each pair.
/// @throws std::runtime_error if the file cannot be written.
void writeRun(const std::string& file, const std::string& name, const SequenceRunResult& result,
              const std::vector<Judged>& judged, const std::vector<StampedPose>& truth);

/// @throws std::runtime_error if a file of this name cannot be written; leaves an existing one as it is.
void requireWritable(const std::string& file);

}  // namespace pi_slam
