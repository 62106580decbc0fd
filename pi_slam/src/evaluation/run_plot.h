#pragma once

#include "evaluation/run_report.h"

#include <string>
#include <vector>

namespace pi_slam
{

/// Writes the run as a picture: paths after each pair and, if there is one, of the map's keyframes, aligned by SE3 if
/// there is truth, with their errors over time.
/// @param file    ends in .png.
/// @param name    of the recording, for the title.
/// @param judged  at least one; the first is that after each pair.
/// @throws std::runtime_error if the file cannot be written.
void writePlot(const std::string& file, const std::string& name, const SequenceRunResult& result,
               const std::vector<Judged>& judged, const std::vector<StampedPose>& truth);

}  // namespace pi_slam
