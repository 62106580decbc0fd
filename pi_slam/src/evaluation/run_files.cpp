#include "evaluation/run_files.h"

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <sstream>
#include <stdexcept>

namespace pi_slam
{

namespace
{

void writeText(const std::string& file, const std::string& text)
{
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream << text;
  if (!stream.flush())
  {
    throw std::runtime_error(file + ": cannot be written; check the folder, its permissions and free space");
  }
}

/// Replaces characters that would end a cell.
std::string cell(std::string text)
{
  for (char& character : text)
  {
    character = character == ',' || character == '\n' ? ';' : character;
  }
  return text;
}

void writeTrajectory(const Judged& judged, std::ostream* stream)
{
  *stream << "trajectory," << cell(judged.name) << "\n";
  const std::vector<StampedPose> poses =
      judged.accuracy ? transformed(judged.poses, judged.accuracy->se3.T_truth_estimate) : judged.poses;
  for (const StampedPose& pose : poses)
  {
    const Eigen::Vector3d p = pose.T_world_body.translation();
    const Eigen::Matrix3d R = pose.T_world_body.linear();
    *stream << "pose," << pose.stamp_ns << ',' << p.x() << ',' << p.y() << ',' << p.z() << ','
            << std::atan2(R(1, 0), R(0, 0)) << "\n";
  }
  if (judged.accuracy)
  {
    const Accuracy& accuracy = *judged.accuracy;
    for (size_t i = 0; i < accuracy.pairs.size(); ++i)
    {
      *stream << "error," << accuracy.pairs[i].stamp_ns << ',' << accuracy.se3.position_errors[i] << ','
              << accuracy.se3.rotation_errors[i] << "\n";
    }
  }
}

}  // namespace

void writeTum(const std::string& file, const std::string& comment, const std::vector<StampedPose>& poses)
{
  std::ostringstream text;
  text << "# " << comment << "\n# timestamp(s) tx ty tz qx qy qz qw\n" << std::fixed << std::setprecision(9);
  for (const StampedPose& pose : poses)
  {
    const Eigen::Vector3d p = pose.T_world_body.translation();
    const Eigen::Quaterniond q(pose.T_world_body.linear());
    text << formatSeconds(pose.stamp_ns) << " " << p.x() << " " << p.y() << " " << p.z() << " " << q.x() << " " << q.y()
         << " " << q.z() << " " << q.w() << "\n";
  }
  writeText(file, text.str());
}

void writeTiming(const std::string& file, const std::vector<PairRecord>& pairs)
{
  std::ostringstream text;
  text
      << "stamp_ns,status,processed,keyframe,reset,reduced,features,inliers,landmarks,iterations,tracked,lost,created,"
         "stereo,parallax_px,flow_px,pyramid_ms,track_ms,detect_ms,stereo_ms,front_end_ms,filter_ms,window_ms,total_ms,"
         "wall_ms,cpu_ms,map_ms,message\n"
      << std::fixed << std::setprecision(4);
  for (const PairRecord& pair : pairs)
  {
    const FrameReport& report = pair.report;
    const TrackerReport& tracker = report.tracker;
    text << report.stamp_ns << ',' << toString(report.status) << ',' << report.processed << ',' << report.keyframe
         << ',' << report.reset << ',' << report.reduced << ',' << report.features << ',' << report.inliers << ','
         << report.landmarks << ',' << report.iterations << ',' << tracker.tracked << ',' << tracker.lost << ','
         << tracker.created << ',' << tracker.stereo << ',' << tracker.parallax_px << ',' << tracker.flow_px << ','
         << tracker.pyramid_ms << ',' << tracker.track_ms << ',' << tracker.detect_ms << ',' << tracker.stereo_ms << ','
         << report.front_end_ms << ',' << report.filter_ms << ',' << report.window_ms << ',' << report.total_ms << ','
         << pair.wall_ms << ',' << pair.cpu_ms << ',' << pair.map_ms << ',' << cell(report.message) << "\n";
  }
  writeText(file, text.str());
}

void writeRun(const std::string& file, const std::string& name, const SequenceRunResult& result,
              const std::vector<Judged>& judged, const std::vector<StampedPose>& truth)
{
  std::ostringstream text;
  const std::vector<StampedPose>& poses = judged.front().poses;
  text << std::setprecision(12) << "name," << cell(name) << "\npairs," << result.pairs.size() << "\nposes,"
       << poses.size() << "\n";
  if (const std::optional<Accuracy>& accuracy = judged.front().accuracy)
  {
    text << "path_m," << accuracy->se3.length_m << "\nse3_rmse_m," << accuracy->se3.position.rmse << "\nyaw_rmse_m,"
         << accuracy->yaw.position.rmse << "\nrotation_rmse_rad," << accuracy->se3.rotation.rmse << "\n";
    for (const StampedPose& pose : truth)
    {
      if (pose.stamp_ns >= poses.front().stamp_ns && pose.stamp_ns <= poses.back().stamp_ns)
      {
        const Eigen::Vector3d p = pose.T_world_body.translation();
        text << "truth," << pose.stamp_ns << ',' << p.x() << ',' << p.y() << ',' << p.z() << "\n";
      }
    }
  }
  writeTrajectory(judged.front(), &text);
  // The poses at IMU rate lie on the same line; only the map's path is added.
  if (judged.back().name == MAP_PATH_NAME && judged.back().accuracy.has_value() == judged.front().accuracy.has_value())
  {
    writeTrajectory(judged.back(), &text);
  }
  for (const StatusInterval& interval : statusIntervals(result.pairs))
  {
    if (interval.status != VioStatus::TRACKING)
    {
      text << "span," << toString(interval.status) << ',' << interval.from_ns << ',' << interval.to_ns << "\n";
    }
  }
  writeText(file, text.str());
}

void requireWritable(const std::string& file)
{
  if (!std::ofstream(file, std::ios::binary | std::ios::app))
  {
    throw std::runtime_error(file + ": cannot be written; check the folder and its permissions");
  }
}

}  // namespace pi_slam
