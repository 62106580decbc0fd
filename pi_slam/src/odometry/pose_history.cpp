#include "odometry/pose_history.h"

#include <algorithm>

namespace pi_slam
{

std::optional<Eigen::Isometry3d> PoseHistory::at(int64_t stamp_ns) const
{
  const auto after = std::lower_bound(poses_.begin(), poses_.end(), stamp_ns,
                                      [](const auto& pose, int64_t stamp) { return pose.first < stamp; });
  if (after == poses_.end() || (after == poses_.begin() && after->first != stamp_ns))
  {
    return std::nullopt;
  }
  if (after->first == stamp_ns)
  {
    return after->second;
  }
  const auto before = std::prev(after);
  const double part = static_cast<double>(stamp_ns - before->first) / static_cast<double>(after->first - before->first);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(before->second.linear())
                   .slerp(part, Eigen::Quaterniond(after->second.linear()))
                   .toRotationMatrix();
  T.translation() = before->second.translation() + part * (after->second.translation() - before->second.translation());
  return T;
}

}  // namespace pi_slam
