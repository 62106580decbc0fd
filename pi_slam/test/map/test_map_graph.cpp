#include "map/map_graph.h"

#include <gtest/gtest.h>

#include <random>

namespace
{

using namespace pi_slam;
using namespace pi_slam::map;

FeatureSetPtr someFeatures(unsigned seed)
{
  std::mt19937 random(seed);
  auto set = std::make_shared<FeatureSet>();
  set->features.resize(60);
  set->descriptors.resize(60 * DESCRIPTOR_BYTES);
  for (uint8_t& byte : set->descriptors)
  {
    byte = static_cast<uint8_t>(random());
  }
  for (MapFeature& feature : set->features)
  {
    feature.inverse_distance = 0.2F;
    feature.inverse_deviation = 0.01F;
  }
  return set;
}

MapNode nodeAt(uint32_t segment, double x, bool keyframe = true)
{
  MapNode node;
  node.segment = segment;
  node.travelled_m = x;
  node.T_odom_body.translation().x() = x;
  node.p_map_body = node.T_odom_body.translation();
  node.features = keyframe ? someFeatures(100 * segment + static_cast<unsigned>(x)) : nullptr;
  return node;
}

/// A segment of keyframes 1 m apart.
uint32_t drive(MapGraph* graph, int metres)
{
  const uint32_t segment = graph->beginSegment();
  std::optional<uint32_t> last;
  for (int i = 0; i < metres; ++i)
  {
    last = graph->add(nodeAt(segment, i), last, 1.0);
  }
  return segment;
}

MapGraph makeGraph()
{
  return MapGraph(StereoCalibration::makeForwardPair(), PlaceVerifierOptions(), nullptr);
}

TEST(MapGraph, KeepsSegmentsApartUntilTheyAreJoined)
{
  MapGraph graph = makeGraph();
  const uint32_t first = drive(&graph, 5);
  const uint32_t second = drive(&graph, 8);
  EXPECT_EQ(13u, graph.keyframes());
  EXPECT_EQ(4u + 7u, graph.data().edges.size());
  EXPECT_NE(graph.partOf(first), graph.partOf(second));
  EXPECT_EQ(8u, graph.largestPart(std::nullopt).nodes.size());

  Eigen::Isometry3d shift = Eigen::Isometry3d::Identity();
  shift.translation() = Eigen::Vector3d(0.0, 3.0, 0.0);
  shift.linear() = Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  graph.movePart(graph.partOf(second), shift);
  EXPECT_EQ(Eigen::Vector3d(4.0, 0.0, 0.0), graph.data().nodes[4].p_map_body);
  EXPECT_LT(
      (graph.data().nodes[12].T_map_body().matrix() - (shift * graph.data().nodes[12].T_odom_body).matrix()).norm(),
      1e-12);

  graph.joinParts(graph.partOf(second), graph.partOf(first));
  EXPECT_EQ(graph.partOf(first), graph.partOf(second));
  const MapData all = graph.largestPart(std::nullopt);
  EXPECT_EQ(13u, all.nodes.size());
  EXPECT_EQ(11u, all.edges.size());
}

TEST(MapGraph, SavesOnlyWhatBelongsToTheLargestPart)
{
  MapGraph graph = makeGraph();
  drive(&graph, 4);
  const uint32_t second = drive(&graph, 6);
  GridPatch patch;
  patch.segment = 0;
  patch.cells.cells = {0};
  patch.cells.width = patch.cells.height = 1;
  graph.addPatch(patch);
  patch.segment = second;
  patch.travelled_m = 2.0;
  const MapData part = graph.largestPart(patch);
  EXPECT_EQ(6u, part.nodes.size());
  ASSERT_EQ(1u, part.patches.size());
  EXPECT_EQ(second, part.patches[0].segment);
  for (const MapEdge& edge : part.edges)
  {
    EXPECT_EQ(edge.from + 1, edge.to);
    EXPECT_LT(edge.to, part.nodes.size());
  }
  EXPECT_TRUE(makeGraph().largestPart(std::nullopt).nodes.empty());
}

TEST(MapGraph, NumbersTheSegmentsOfAFileAnew)
{
  MapData data;
  for (const uint32_t segment : {7U, 7U, 4U})
  {
    data.nodes.push_back(nodeAt(segment, static_cast<double>(data.nodes.size())));
    data.nodes.back().serial = data.nodes.size() - 1;
  }
  GridPatch patch;
  patch.segment = 4;
  data.patches.push_back(patch);
  patch.segment = 9;  // of no node
  data.patches.push_back(patch);
  MapGraph graph = makeGraph();
  graph.load(data);
  EXPECT_EQ(0u, graph.data().nodes[0].segment);
  EXPECT_EQ(1u, graph.data().nodes[2].segment);
  ASSERT_EQ(1u, graph.data().patches.size());
  EXPECT_EQ(1u, graph.data().patches[0].segment);
  EXPECT_EQ(0u, graph.partOf(0));
  EXPECT_EQ(0u, graph.partOf(1));
  const uint32_t now = graph.beginSegment();
  EXPECT_EQ(2u, now);
  EXPECT_EQ(2u, graph.partOf(now));
  EXPECT_EQ(3u, graph.data().nodes[graph.add(nodeAt(now, 0.0), std::nullopt, 1.0)].serial);
}

TEST(MapGraph, CountsKeyframesThatLookTheSameWay)
{
  MapGraph graph = makeGraph();
  const uint32_t segment = drive(&graph, 3);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = 1.0;
  EXPECT_EQ(1, graph.countNear(T, graph.partOf(segment), 0.5, 0.2));
  EXPECT_EQ(3, graph.countNear(T, graph.partOf(segment), 1.5, 0.2));
  EXPECT_EQ(0, graph.countNear(T, graph.partOf(segment) + 1, 1.5, 0.2));
  T.linear() = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  EXPECT_EQ(0, graph.countNear(T, graph.partOf(segment), 1.5, 0.2));
}

}  // namespace
