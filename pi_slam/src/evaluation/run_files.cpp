#include "evaluation/run_files.h"

#include <Eigen/Geometry>
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

/// Without what would end a cell.
std::string cell(std::string text)
{
  for (char& character : text)
  {
    character = character == ',' || character == '\n' ? ';' : character;
  }
  return text;
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
         "wall_ms,cpu_ms,map_ms,time_offset_s,message\n"
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
         << pair.wall_ms << ',' << pair.cpu_ms << ',' << pair.map_ms << ',' << std::setprecision(6)
         << report.time_offset_s << std::setprecision(4) << ',' << cell(report.message) << "\n";
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
