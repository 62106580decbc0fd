#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "odometry/pose_history.h"

namespace pi_slam
{

/// The poses that are kept of one run of odometry: of the last seconds, of the path, and the place of odom in map.
/// Not thread safe.
struct VioPoses
{
  using Path = std::vector<std::pair<int64_t, Eigen::Isometry3d>>;
  struct MapPlace
  {
    Eigen::Isometry3d T_map_odom = Eigen::Isometry3d::Identity();
    std::optional<Eigen::Matrix4d> covariance;  ///< of MapStatistics; nullopt: not localised in the map
  };

  void clear(const Eigen::Isometry3d& T_map_odom)
  {
    map_place = {T_map_odom, std::nullopt};
    path.clear();
    history.clear();
  }
  void keepForPath(int64_t stamp_ns, const Eigen::Isometry3d& T_odom_body, double spacing_m, size_t most)
  {
    if (path.empty() || !((path.back().second.translation() - T_odom_body.translation()).norm() < spacing_m))
    {
      path.emplace_back(stamp_ns, T_odom_body);
    }
    if (path.size() > most)
    {
      path.pop_front();
    }
  }
  Path pathInMap() const
  {
    Path in_map;
    for (const auto& [stamp_ns, T_odom_body] : path)
    {
      in_map.emplace_back(stamp_ns, map_place.T_map_odom * T_odom_body);
    }
    return in_map;
  }

  MapPlace map_place;
  PoseHistory history{5000000000, 4000000};  ///< T_odom_base as published: 5 s, for poses that are set later
  std::deque<std::pair<int64_t, Eigen::Isometry3d>> path;  ///< T_odom_body
};

}  // namespace pi_slam
