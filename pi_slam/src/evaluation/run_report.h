#pragma once

#include "evaluation/sequence_run.h"

#include "evaluation/trajectory_metrics.h"

#include <iosfwd>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace pi_slam
{

/// How near one of the trajectories of a run is to the truth.
struct Accuracy
{
  std::string name;
  std::vector<PosePair> pairs;
  AbsoluteError se3;
  AbsoluteError yaw;
  std::vector<std::pair<std::string, RelativeError>>
      relative;  ///< "1 m", "1 s", ...; those the path is long enough for
};

/// @throws TrajectoryError if fewer than three poses lie within the truth.
Accuracy assess(const std::string& name, const std::vector<StampedPose>& poses, const std::vector<StampedPose>& truth);

/// A trajectory of the run and, with ground truth, how near it came.
struct Judged
{
  std::string name;
  std::vector<StampedPose> poses;
  std::optional<Accuracy> accuracy;
};
/// Poses after each pair, at IMU rate and, with a map, of its keyframes, as far as there are any, in this order. Prints
/// the accuracy of each, or why it has none.
/// @param truth  may be empty.
std::vector<Judged> judge(const SequenceRunResult& result, const std::vector<StampedPose>& truth, std::ostream* stream);

/// Name of the keyframes' trajectory.
constexpr char MAP_PATH_NAME[] = "keyframes in the map";

/// Prints what became of the pairs: counts, start, intervals without sight, warnings, time per stage.
void printRun(const SequenceRunResult& result, const SequenceDescription& description, const SequenceDefects& defects,
              std::ostream* stream);

/// Prints absolute and relative errors as a table.
void printAccuracy(const Accuracy& accuracy, std::ostream* stream);

}  // namespace pi_slam
