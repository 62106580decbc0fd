#include "map/voxel_cloud.h"

#include <pcl/filters/voxel_grid.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <cmath>

namespace pi_slam::map
{

namespace
{

constexpr double BLOCK_VOXELS = 512.0;  ///< VoxelGrid numbers voxels by 32 bits: 512^3 of them fit
constexpr double MAX_PART = 0.1;        ///< deviation of a distance, as part of it, of points that are shown
constexpr double MAX_DEVIATION_M = 0.5;

}  // namespace

VoxelCloud::VoxelCloud(double voxel_m, double max_range_m) : voxel_m_(voxel_m), max_range_m_(max_range_m) {}

void VoxelCloud::add(const MapNode& node, std::map<Block, bool>* touched)
{
  const Eigen::Isometry3d T_map_body = node.T_map_body();
  const Eigen::Isometry3f T = T_map_body.cast<float>();
  for (const MapFeature& feature : node.features->features)
  {
    const double inverse = feature.inverse_distance;
    const double deviation = feature.inverse_deviation;  // relative: deviation / inverse
    if (!(inverse * max_range_m_ >= 1.0) || deviation > MAX_PART * inverse ||
        deviation > MAX_DEVIATION_M * inverse * inverse)
    {
      continue;
    }
    MapPoint point;
    point.p_map = T * (node.features->p_body_camera + feature.bearing / feature.inverse_distance);
    point.grey = feature.grey;
    const Eigen::Vector3d cell = (point.p_map.cast<double>() / (BLOCK_VOXELS * voxel_m_)).array().floor();
    if (!(cell.cwiseAbs().maxCoeff() < 1e9))
    {
      continue;
    }
    const Block block{static_cast<int>(cell.x()), static_cast<int>(cell.y()), static_cast<int>(cell.z())};
    blocks_[block].push_back(point);
    (*touched)[block] = true;
  }
  added_[node.serial] = T_map_body;
}

void VoxelCloud::filter(std::vector<MapPoint>* points) const
{
  pcl::PointCloud<pcl::PointXYZI>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZI>);
  cloud->reserve(points->size());
  for (const MapPoint& point : *points)
  {
    pcl::PointXYZI p;
    p.getVector3fMap() = point.p_map;
    p.intensity = point.grey;
    cloud->push_back(p);
  }
  pcl::VoxelGrid<pcl::PointXYZI> grid;
  const auto leaf = static_cast<float>(voxel_m_);
  grid.setLeafSize(leaf, leaf, leaf);
  grid.setInputCloud(cloud);
  pcl::PointCloud<pcl::PointXYZI> filtered;
  grid.filter(filtered);
  points->clear();
  points->reserve(filtered.size());
  for (const pcl::PointXYZI& p : filtered)
  {
    points->push_back({p.getVector3fMap(), static_cast<uint8_t>(std::lround(p.intensity))});
  }
}

const std::vector<MapPoint>& VoxelCloud::update(const MapData& map)
{
  size_t known = 0;
  bool moved = false;
  for (const MapNode& node : map.nodes)
  {
    const auto found = node.features ? added_.find(node.serial) : added_.end();
    if (found != added_.end())
    {
      ++known;
      const Eigen::Isometry3d T = node.T_map_body();
      const double turn = Eigen::AngleAxisd(found->second.linear().transpose() * T.linear()).angle();
      // At ten metres a turn moves a point ten times as much.
      moved = moved || (found->second.translation() - T.translation()).norm() + 10.0 * turn > voxel_m_;
    }
  }
  const bool anew = moved || known != added_.size();
  if (anew)
  {
    blocks_.clear();
    added_.clear();
  }
  std::map<Block, bool> touched;
  for (const MapNode& node : map.nodes)
  {
    if (node.features && added_.count(node.serial) == 0)
    {
      add(node, &touched);
    }
  }
  if (touched.empty() && !anew)
  {
    return points_;
  }
  for (const auto& entry : touched)
  {
    filter(&blocks_[entry.first]);
  }
  points_.clear();
  for (const auto& block : blocks_)
  {
    points_.insert(points_.end(), block.second.begin(), block.second.end());
  }
  return points_;
}

}  // namespace pi_slam::map
