#include <gtest/gtest.h>

#include "map/voxel_cloud.h"

namespace
{

using namespace pi_slam;
using namespace pi_slam::map;

MapFeature pointAt(double distance_m, double deviation = 0.001)
{
  MapFeature feature;
  feature.inverse_distance = static_cast<float>(1.0 / distance_m);
  feature.inverse_deviation = static_cast<float>(deviation);
  feature.grey = 100;
  return feature;
}

MapNode nodeAt(uint64_t serial, const Eigen::Vector3d& p, std::vector<MapFeature> features)
{
  MapNode node;
  node.serial = serial;
  node.p_map_body = p;
  auto set = std::make_shared<FeatureSet>();
  set->descriptors.resize(features.size() * DESCRIPTOR_BYTES);
  set->features = std::move(features);
  node.features = set;
  return node;
}

TEST(VoxelCloud, HasOnePointPerVoxelAndOnlyCertainOnesInRange)
{
  VoxelCloud cloud(0.1, 20.0);
  MapData map;
  EXPECT_TRUE(cloud.update(map).empty());
  map.nodes.push_back(
      nodeAt(1, {0.05, 0.05, 0.05}, {pointAt(5.0), pointAt(5.01), pointAt(15.0), pointAt(25.0), pointAt(5.2, 0.05)}));
  const std::vector<MapPoint> points = cloud.update(map);
  ASSERT_EQ(2u, points.size());
  EXPECT_NEAR(5.055F, points[0].p_map.x(), 1e-3F);  // mean of two
  EXPECT_NEAR(15.05F, points[1].p_map.x(), 1e-3F);
  EXPECT_EQ(100, points[0].grey);
}

TEST(VoxelCloud, FollowsKeyframesThatComeMoveAndGo)
{
  VoxelCloud cloud(0.1, 20.0);
  MapData map;
  map.nodes.push_back(nodeAt(1, {0.0, 0.0, 0.0}, {pointAt(5.0)}));
  EXPECT_EQ(1u, cloud.update(map).size());
  map.nodes.push_back(nodeAt(2, {0.0, 3.0, 0.0}, {pointAt(5.0)}));
  EXPECT_EQ(2u, cloud.update(map).size());
  map.nodes[1].p_map_body.y() = 3.02;  // less than a voxel: not worth the work
  EXPECT_EQ(3.0F, cloud.update(map)[1].p_map.y());
  map.nodes[1].p_map_body.y() = 4.0;
  EXPECT_EQ(4.0F, cloud.update(map)[1].p_map.y());
  map.nodes[0].features.reset();
  ASSERT_EQ(1u, cloud.update(map).size());
  EXPECT_EQ(4.0F, cloud.update(map)[0].p_map.y());
  map.nodes.clear();
  EXPECT_TRUE(cloud.update(map).empty());
}

TEST(VoxelCloud, WorksOverKilometresWithSmallVoxels)
{
  VoxelCloud cloud(0.01, 20.0);
  MapData map;
  for (int i = 0; i < 10; ++i)
  {
    map.nodes.push_back(nodeAt(static_cast<uint64_t>(i), {500.0 * i, -300.0 * i, 0.0}, {pointAt(5.0), pointAt(5.0)}));
  }
  EXPECT_EQ(10u, cloud.update(map).size());
}

}  // namespace
