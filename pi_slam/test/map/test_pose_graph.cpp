#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "map/pose_graph.h"
#include "map/redundancy.h"

namespace
{

using namespace pi_slam::map;

Eigen::Vector3d turned(double angle, const Eigen::Vector3d& v)
{
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()) * v;
}

struct Truth
{
  Eigen::Vector3d p;
  double heading;
};

MapEdge edgeBetween(const std::vector<Truth>& truth, uint32_t from, uint32_t to)
{
  MapEdge edge;
  edge.from = from;
  edge.to = to;
  edge.shift = turned(-truth[from].heading, truth[to].p - truth[from].p);
  edge.turn = truth[to].heading - truth[from].heading;
  return edge;
}

/// Two rounds on a circle of 20 m, whose odometry drifts, with loops between the rounds.
struct TwoRounds
{
  explicit TwoRounds(int count = 400)
  {
    std::mt19937_64 random(3);
    std::normal_distribution<double> noise;
    for (int i = 0; i < count; ++i)
    {
      const double angle = 4.0 * M_PI * i / count;
      // heading: of odom in map, which is 0 in truth. Here it walks, to see that turns are right.
      truth.push_back({Eigen::Vector3d(20.0 * std::cos(angle), 20.0 * std::sin(angle), 0.5 * std::sin(angle)),
                       0.2 * std::sin(3.0 * angle)});
    }
    for (int i = 0; i < count; ++i)
    {
      MapNode node;
      node.serial = static_cast<uint64_t>(i);
      if (i == 0)
      {
        node.p_map_body = truth[0].p;
        node.heading = truth[0].heading;
      }
      else
      {
        MapEdge edge = edgeBetween(truth, static_cast<uint32_t>(i - 1), static_cast<uint32_t>(i));
        edge.position_deviation = 0.01;
        edge.heading_deviation = 0.003;
        edge.shift += 0.01 * Eigen::Vector3d{noise(random), noise(random), noise(random)};
        edge.turn += 0.003 * noise(random);
        map.edges.push_back(edge);
        const MapNode& before = map.nodes.back();
        node.p_map_body = before.p_map_body + turned(before.heading, edge.shift);
        node.heading = before.heading + edge.turn;
      }
      map.nodes.push_back(node);
    }
    for (int i = count / 2; i < count; i += 10)
    {
      MapEdge edge = edgeBetween(truth, static_cast<uint32_t>(i - count / 2), static_cast<uint32_t>(i));
      edge.loop = true;
      edge.position_deviation = 0.02;
      edge.heading_deviation = 0.003;
      map.edges.push_back(edge);
    }
  }

  double worstError() const
  {
    double worst = 0.0;
    for (size_t i = 0; i < truth.size(); ++i)
    {
      worst = std::max(worst, (map.nodes[i].p_map_body - truth[i].p).norm());
    }
    return worst;
  }

  /// Half the sum of squares of what edges and nodes differ by, in deviations.
  double cost() const
  {
    double sum = 0.0;
    for (const MapEdge& edge : map.edges)
    {
      const MapNode& from = map.nodes[edge.from];
      const MapNode& to = map.nodes[edge.to];
      const Eigen::Vector3d shift = turned(-from.heading, to.p_map_body - from.p_map_body) - edge.shift;
      const double turn = std::remainder(to.heading - from.heading - edge.turn, 2.0 * M_PI);
      sum += 0.5 * (shift / edge.position_deviation).squaredNorm() + 0.5 * std::pow(turn / edge.heading_deviation, 2);
    }
    return sum;
  }

  std::vector<Truth> truth;
  MapData map;
};

TEST(PoseGraph, BringsTheSecondRoundOntoTheFirst)
{
  TwoRounds rounds;
  const double before = rounds.worstError();
  const double cost_before = rounds.cost();
  ASSERT_TRUE(optimizePoseGraph(&rounds.map));
  EXPECT_LT(rounds.cost(), 0.5 * cost_before);
  EXPECT_GT(before, 0.5);
  // Between the rounds loops tie to centimetres; what the first round drifted within itself stays.
  for (size_t i = 200; i < 400; i += 10)
  {
    const Eigen::Vector3d apart = rounds.map.nodes[i].p_map_body - rounds.map.nodes[i - 200].p_map_body;
    EXPECT_LT((apart - (rounds.truth[i].p - rounds.truth[i - 200].p)).norm(), 0.06) << i;
  }
}

TEST(PoseGraph, DoesNotFollowOneLoopThatAllOthersContradict)
{
  TwoRounds rounds;
  MapEdge wrong = edgeBetween(rounds.truth, 50, 305);
  wrong.loop = true;
  wrong.shift += Eigen::Vector3d(5.0, -3.0, 0.0);
  wrong.position_deviation = 0.02;
  wrong.heading_deviation = 0.003;
  TwoRounds without = rounds;
  rounds.map.edges.push_back(wrong);
  ASSERT_TRUE(optimizePoseGraph(&without.map));
  ASSERT_TRUE(optimizePoseGraph(&rounds.map));
  for (size_t i = 0; i < rounds.map.nodes.size(); ++i)
  {
    EXPECT_LT((rounds.map.nodes[i].p_map_body - without.map.nodes[i].p_map_body).norm(), 0.1) << i;
  }
}

TEST(PoseGraph, LetsALargeCorrectionThrough)
{
  TwoRounds rounds;
  rounds.map.edges.erase(rounds.map.edges.begin() + 399, rounds.map.edges.end());
  for (MapNode& node : rounds.map.nodes)  // odometry that lost 8 m and 20 degrees on the way
  {
    const double part = static_cast<double>(node.serial) / 400.0;
    node.p_map_body += part * Eigen::Vector3d(8.0, 0.0, 0.0);
    node.heading += 0.35 * part;
  }
  for (MapEdge& edge : rounds.map.edges)
  {
    const MapNode& a = rounds.map.nodes[edge.from];
    const MapNode& b = rounds.map.nodes[edge.to];
    edge.shift = turned(-a.heading, b.p_map_body - a.p_map_body);
    edge.turn = b.heading - a.heading;
  }
  MapEdge loop = edgeBetween(rounds.truth, 0, 399);
  loop.loop = true;
  loop.position_deviation = 0.02;
  loop.heading_deviation = 0.003;
  rounds.map.edges.push_back(loop);
  ASSERT_TRUE(optimizePoseGraph(&rounds.map));
  const Eigen::Vector3d end = rounds.map.nodes[399].p_map_body - rounds.map.nodes[0].p_map_body;
  EXPECT_LT((turned(-rounds.map.nodes[0].heading, end) - loop.shift).norm(), 0.1);
}

TEST(PoseGraph, LeavesPartsThatNothingJoinsWhereTheyAre)
{
  MapData map;
  for (int i = 0; i < 4; ++i)
  {
    MapNode node;
    node.p_map_body = Eigen::Vector3d(10.0 * i, 0.0, 0.0);
    map.nodes.push_back(node);
  }
  MapEdge edge;
  edge.shift = Eigen::Vector3d(1.0, 0.0, 0.0);
  edge.from = 0;
  edge.to = 1;
  map.edges.push_back(edge);
  edge.from = 3;
  edge.to = 2;
  map.edges.push_back(edge);
  ASSERT_TRUE(optimizePoseGraph(&map));
  EXPECT_NEAR(0.0, map.nodes[0].p_map_body.x(), 1e-12);
  EXPECT_NEAR(1.0, map.nodes[1].p_map_body.x(), 1e-6);
  EXPECT_NEAR(20.0, map.nodes[2].p_map_body.x(), 1e-12);
  EXPECT_NEAR(19.0, map.nodes[3].p_map_body.x(), 1e-6);
}

TEST(PoseGraph, ChangesNothingWithoutEdgesOrWithNumbersThatAreNone)
{
  MapData map;
  EXPECT_FALSE(optimizePoseGraph(&map));
  map.nodes.resize(2);
  EXPECT_FALSE(optimizePoseGraph(&map));
  MapEdge edge;
  edge.to = 1;
  edge.shift = Eigen::Vector3d(std::nan(""), 0.0, 0.0);
  map.edges.push_back(edge);
  EXPECT_FALSE(optimizePoseGraph(&map));
  EXPECT_EQ(0.0, map.nodes[1].p_map_body.x());
}

TEST(Redundancy, ComposesAndInvertsEdges)
{
  const std::vector<Truth> truth{{{0, 0, 0}, 0.3}, {{1, 2, 0.5}, -0.4}, {{-3, 1, 1}, 2.0}};
  const MapEdge whole = compose(edgeBetween(truth, 0, 1), edgeBetween(truth, 1, 2));
  const MapEdge direct = edgeBetween(truth, 0, 2);
  EXPECT_LT((whole.shift - direct.shift).norm(), 1e-12);
  EXPECT_NEAR(whole.turn, direct.turn, 1e-12);
  EXPECT_EQ(0u, whole.from);
  EXPECT_EQ(2u, whole.to);
  const MapEdge back = inverse(direct);
  const MapEdge expected = edgeBetween(truth, 2, 0);
  EXPECT_LT((back.shift - expected.shift).norm(), 1e-12);
  EXPECT_NEAR(back.turn, expected.turn, 1e-12);
}

TEST(Redundancy, TakesTheKeyframesThatStandClosest)
{
  MapData map;
  const auto features = std::make_shared<FeatureSet>();
  for (int i = 0; i < 40; ++i)
  {
    MapNode node;
    node.features = features;
    // Every metre; numbers 10 and 11 nearly at the same place.
    node.p_map_body = Eigen::Vector3d(i == 11 ? 10.05 : i, 0.0, 0.0);
    map.nodes.push_back(node);
  }
  EXPECT_TRUE(redundantKeyframes(map, 40, 0.5, 0.26).empty());
  const std::vector<size_t> gone = redundantKeyframes(map, 39, 0.5, 0.26);
  ASSERT_EQ(2u, gone.size());  // one in twenty
  EXPECT_TRUE(gone[0] == 10 || gone[0] == 11);
  // Whatever the number, it is enough, and the newest ones stay.
  const std::vector<size_t> many = redundantKeyframes(map, 10, 0.5, 0.26);
  EXPECT_EQ(30u, many.size());
  for (const size_t node : many)
  {
    EXPECT_LT(node, 35u);
  }
}

TEST(Redundancy, ThinsNodesOutAndKeepsWhatTheirEdgesSay)
{
  TwoRounds rounds;
  for (size_t i = 0; i < rounds.map.nodes.size(); i += 40)
  {
    rounds.map.nodes[i].features = std::make_shared<FeatureSet>();
  }
  for (MapEdge& edge : rounds.map.edges)  // exact, so that sums can be checked
  {
    const bool loop = edge.loop;
    edge = edgeBetween(rounds.truth, edge.from, edge.to);
    edge.loop = loop;
    edge.position_deviation = 0.01;
    edge.heading_deviation = 0.001;
  }
  MapData map = rounds.map;
  EXPECT_FALSE(thinOut(&map, 400).has_value());
  const auto moved = thinOut(&map, 300);
  ASSERT_TRUE(moved.has_value());
  EXPECT_LT(map.nodes.size(), 330u);
  EXPECT_GT(map.nodes.size(), 250u);
  size_t odometry = 0;
  for (const MapEdge& edge : map.edges)
  {
    ASSERT_LT(edge.from, map.nodes.size());
    ASSERT_LT(edge.to, map.nodes.size());
    const MapEdge expected = edgeBetween(rounds.truth, static_cast<uint32_t>(map.nodes[edge.from].serial),
                                         static_cast<uint32_t>(map.nodes[edge.to].serial));
    EXPECT_LT((edge.shift - expected.shift).norm(), 1e-9);
    EXPECT_NEAR(0.0, std::remainder(edge.turn - expected.turn, 2.0 * M_PI), 1e-9);
    odometry += edge.loop ? 0 : 1;
  }
  EXPECT_EQ(map.nodes.size() - 1, odometry);  // still one chain
  for (size_t i = 0; i < rounds.map.nodes.size(); ++i)
  {
    if (rounds.map.nodes[i].features)
    {
      ASSERT_GE((*moved)[i], 0) << "a keyframe was taken out";
      EXPECT_EQ(i, map.nodes[static_cast<size_t>((*moved)[i])].serial);
    }
  }
}

}  // namespace
