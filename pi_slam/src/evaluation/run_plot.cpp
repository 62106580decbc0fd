#include "evaluation/run_plot.h"

#include "evaluation/trajectory_plot.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <stdexcept>

namespace pi_slam
{

namespace
{

PlottedTrajectory plotted(const Judged& judged)
{
  PlottedTrajectory curve;
  curve.name = judged.name;
  if (!judged.accuracy)
  {
    curve.poses = judged.poses;
    return curve;
  }
  const AbsoluteError& error = judged.accuracy->se3;
  curve.poses = transformed(judged.poses, error.T_truth_estimate);
  for (const PosePair& pair : judged.accuracy->pairs)
  {
    curve.error_stamps.push_back(pair.stamp_ns);
  }
  curve.position_errors = error.position_errors;
  curve.rotation_errors = error.rotation_errors;
  return curve;
}

/// Truth from the first to the last pose that was estimated.
std::vector<StampedPose> during(const std::vector<StampedPose>& truth, const std::vector<StampedPose>& poses)
{
  std::vector<StampedPose> part;
  std::copy_if(truth.begin(), truth.end(), std::back_inserter(part),
               [&](const StampedPose& pose)
               { return pose.stamp_ns >= poses.front().stamp_ns && pose.stamp_ns <= poses.back().stamp_ns; });
  return part;
}

std::string millimetres(double metres)
{
  std::ostringstream text;
  text << std::fixed << std::setprecision(metres < 0.1 ? 1 : 0) << 1e3 * metres << " mm";
  return text.str();
}

}  // namespace

void writePlot(const std::string& file, const std::string& name, const SequenceRunResult& result,
               const std::vector<Judged>& judged, const std::vector<StampedPose>& truth)
{
  TrajectoryPlot plot;
  const std::optional<Accuracy>& accuracy = judged.front().accuracy;
  plot.title = name + (accuracy ? ": ATE " + millimetres(accuracy->se3.position.rmse) : ": no ground truth");
  std::ostringstream subtitle;
  subtitle << std::fixed << std::setprecision(1) << result.pairs.size() << " stereo pairs, "
           << judged.front().poses.size() << " poses";
  if (accuracy)
  {
    subtitle << ", path " << accuracy->se3.length_m << " m;  RMSE of position after SE3 alignment "
             << millimetres(accuracy->se3.position.rmse) << ", after yaw alignment "
             << millimetres(accuracy->yaw.position.rmse) << ";  rotation " << std::setprecision(2)
             << accuracy->se3.rotation.rmse * 180.0 / M_PI << " deg";
    plot.truth = during(truth, judged.front().poses);
  }
  plot.subtitle = subtitle.str();
  plot.trajectories.push_back(plotted(judged.front()));
  // At IMU rate it is the same line: only the map's path is drawn beside.
  if (judged.back().name == MAP_PATH_NAME && judged.back().accuracy.has_value() == accuracy.has_value())
  {
    plot.trajectories.push_back(plotted(judged.back()));
  }
  for (const StatusInterval& interval : statusIntervals(result.pairs))
  {
    if (interval.status != VioStatus::TRACKING)
    {
      plot.spans.push_back({toString(interval.status), interval.from_ns, interval.to_ns});
    }
  }
  if (!cv::imwrite(file, drawTrajectoryPlot(plot)))
  {
    throw std::runtime_error(file + ": cannot be written; check the folder and its free space");
  }
}

}  // namespace pi_slam
