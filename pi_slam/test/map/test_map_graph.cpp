#include "map/map_graph.h"
#include "map/mapper.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>

#include <algorithm>
#include <random>

namespace
{

using namespace pi_slam;
using namespace pi_slam::map;
using pi_node::test_support::TemporaryFolder;

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
  EXPECT_EQ(13u, graph.counts().keyframes);
  EXPECT_EQ(4u + 7u, graph.data().edges.size());
  EXPECT_NE(graph.partOf(first), graph.partOf(second));
  EXPECT_EQ(graph.partOf(second), graph.largestPart());
  EXPECT_EQ(8u, graph.copyOf(graph.largestPart(), std::nullopt).nodes.size());

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
  const MapData all = graph.copyOf(graph.partOf(first), std::nullopt);
  EXPECT_EQ(13u, all.nodes.size());
  EXPECT_EQ(11u, all.edges.size());
}

TEST(MapGraph, CopiesOnlyWhatBelongsToAPart)
{
  MapGraph graph = makeGraph();
  drive(&graph, 4);
  const uint32_t second = drive(&graph, 6);
  GridPatch patch;
  patch.segment = 0;
  patch.cells = OccupancyCells{Eigen::Vector2d::Zero(), 0.1, 1, 1, {0}};
  graph.addPatch(patch);
  patch.segment = second;
  patch.travelled_m = 2.0;
  const MapData part = graph.copyOf(graph.partOf(second), patch);
  EXPECT_EQ(6u, part.nodes.size());
  ASSERT_EQ(1u, part.patches.size());
  EXPECT_EQ(second, part.patches[0].segment);
  for (const MapEdge& edge : part.edges)
  {
    EXPECT_EQ(edge.from + 1, edge.to);
    EXPECT_LT(edge.to, part.nodes.size());
  }
  EXPECT_TRUE(makeGraph().copyOf(makeGraph().largestPart(), std::nullopt).nodes.empty());
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

/// What a set holds, to be compared.
std::vector<uint8_t> contentOf(const FeatureSet& set)
{
  std::vector<uint8_t> bytes = set.descriptors;
  for (const MapFeature& feature : set.features)
  {
    bytes.push_back(feature.grey);
    bytes.push_back(static_cast<uint8_t>(100.0F * feature.inverse_distance));
  }
  return bytes;
}

TEST(FeatureStore, GivesBackWhatItTook)
{
  const TemporaryFolder folder;
  FeatureStore store(folder.path());
  std::vector<FeatureSetPtr> sets;
  std::vector<StoredFeaturesPtr> stored;
  for (unsigned i = 0; i < 20; ++i)
  {
    sets.push_back(someFeatures(i));
    stored.push_back(store.write(*sets.back()));
    EXPECT_EQ(60u, stored.back()->size());
  }
  const uint64_t bytes = store.bytes();
  for (unsigned i = 0; i < 20; ++i)
  {
    EXPECT_EQ(contentOf(*sets[i]), contentOf(*stored[i]->load())) << i;
  }
  stored.resize(5);
  for (unsigned i = 0; i < 15; ++i)
  {
    stored.push_back(store.write(*someFeatures(100 + i)));
  }
  EXPECT_EQ(bytes, store.bytes()) << "room of those that went is used again";
  EXPECT_EQ(contentOf(*someFeatures(100)), contentOf(*stored[5]->load()));
  EXPECT_EQ(contentOf(*sets[4]), contentOf(*stored[4]->load()));
}

TEST(FeatureStore, NamesAFolderThatCannotBeUsed)
{
  try
  {
    FeatureStore store("/nowhere/at all");
    FAIL();
  }
  catch (const MapError& error)
  {
    EXPECT_NE(std::string::npos, std::string(error.what()).find("/nowhere/at all: cannot make a file in it"))
        << error.what();
  }
}

/// A segment of keyframes 1 m apart, beside a store.
struct LongDrive
{
  LongDrive() : graph(StereoCalibration::makeForwardPair(), PlaceVerifierOptions(), nullptr, folder.path())
  {
    drive(&graph, 300);
  }
  bool isInMemory(size_t node) const { return graph.data().nodes[node].features != nullptr; }

  TemporaryFolder folder;
  MapGraph graph;
};

TEST(MapGraph, KeepsTheGroundAroundThePlaceInMemory)
{
  LongDrive drive;
  EXPECT_EQ(300u, drive.graph.counts().in_memory);
  const size_t bytes = drive.graph.bytes();
  drive.graph.loadAround({290.0, 0.0, 0.0}, 0, 100);
  EXPECT_EQ(300u, drive.graph.counts().keyframes);
  EXPECT_EQ(300u * 60u, drive.graph.counts().landmarks);
  EXPECT_LE(drive.graph.counts().in_memory, 100u);
  EXPECT_GE(drive.graph.counts().in_memory, 70u);
  EXPECT_TRUE(drive.isInMemory(290));
  EXPECT_FALSE(drive.isInMemory(10));
  EXPECT_LT(drive.graph.bytes(), bytes);
  EXPECT_GT(drive.graph.bytesOnDisk(), 200u * 60u * DESCRIPTOR_BYTES);

  const uint64_t on_disk = drive.graph.bytesOnDisk();
  for (int round = 0; round < 3; ++round)
  {
    drive.graph.loadAround({10.0, 0.0, 0.0}, 0, 100);
    EXPECT_TRUE(drive.isInMemory(10));
    EXPECT_FALSE(drive.isInMemory(290));
    drive.graph.loadAround({290.0, 0.0, 0.0}, 0, 100);
  }
  EXPECT_LE(drive.graph.bytesOnDisk(), on_disk * 3 / 2) << "each set is written once";
  for (size_t i = 0; i < 300; ++i)
  {
    ASSERT_EQ(contentOf(*someFeatures(static_cast<unsigned>(i))), contentOf(*drive.graph.data().nodes[i].allFeatures()))
        << i;
  }
}

TEST(MapGraph, SearchesAllOfItTurnByTurn)
{
  LongDrive drive;
  drive.graph.loadAround({0.0, 0.0, 0.0}, 0, 100);
  std::vector<bool> seen(300, false);
  for (int turn = 0; turn < 4; ++turn)
  {
    drive.graph.loadNext(100);
    EXPECT_LE(drive.graph.counts().in_memory, 100u);
    for (size_t i = 0; i < seen.size(); ++i)
    {
      seen[i] = seen[i] || drive.isInMemory(i);
    }
  }
  EXPECT_EQ(300, std::count(seen.begin(), seen.end(), true));
}

TEST(MapGraph, BoundsWhatIsOnDiskAsWell)
{
  LongDrive drive;
  drive.graph.loadAround({290.0, 0.0, 0.0}, 0, 50);
  EXPECT_FALSE(drive.graph.bound(300, 0.5, 0.3));
  drive.graph.bound(200, 0.5, 0.3);
  EXPECT_LE(drive.graph.counts().keyframes, 200u);
  EXPECT_GE(drive.graph.counts().keyframes, 180u);
}

}  // namespace
