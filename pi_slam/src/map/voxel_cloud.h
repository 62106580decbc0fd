#pragma once

#include "map/mapper.h"

#include <array>
#include <map>
#include <unordered_map>
#include <vector>

#include "map/map_data.h"

namespace pi_slam::map
{

/// The landmarks of a map in space, one per voxel (PCL's VoxelGrid), kept up to date: new keyframes are added. The
/// cloud is computed again only if other keyframes have moved or gone. Not thread safe.
class VoxelCloud
{
public:
  VoxelCloud(double voxel_m, double max_range_m);

  const std::vector<MapPoint>& update(const MapData& map);

private:
  using Block = std::array<int, 3>;  ///< which cube of BLOCK_VOXELS voxels' side
  void add(const MapNode& node, std::map<Block, bool>* touched);
  void filter(std::vector<MapPoint>* points) const;

  const double voxel_m_;
  const double max_range_m_;
  std::map<Block, std::vector<MapPoint>> blocks_;
  std::unordered_map<uint64_t, Eigen::Isometry3d> added_;  ///< T_map_body of keyframes by serial, as added
  std::vector<MapPoint> points_;
};

}  // namespace pi_slam::map
