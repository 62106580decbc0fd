#include <pi_runtime/task_graph.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace pi_runtime
{
namespace
{

using Edges = std::vector<TaskGraph::Edge>;

std::vector<uint32_t> nodesOf(TaskGraph::Links links)
{
  std::vector<uint32_t> nodes;
  for (const TaskGraph::Link& link : links)
  {
    nodes.push_back(link.node);
  }
  return nodes;
}

/// @return message of the exception that making the graph throws; empty if there is none.
std::string refusal(uint32_t nodes, const Edges& edges)
{
  try
  {
    TaskGraph graph(nodes, edges);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

/// Edges from smaller to larger numbers, then renumbered: acyclic, and the numbers say nothing about the order.
Edges randomEdges(uint32_t nodes, std::size_t count, std::mt19937_64* random)
{
  std::vector<uint32_t> names(nodes);
  for (uint32_t i = 0; i < nodes; ++i)
  {
    names[i] = i;
  }
  std::shuffle(names.begin(), names.end(), *random);
  std::uniform_int_distribution<uint32_t> draw(0, nodes - 1);
  std::set<std::pair<uint32_t, uint32_t>> pairs;
  while (pairs.size() < count)
  {
    const auto [low, high] = std::minmax({draw(*random), draw(*random)});
    if (low < high)
    {
      pairs.insert({low, high});
    }
  }
  Edges edges;
  for (const auto& [low, high] : pairs)
  {
    edges.push_back({names[low], names[high], 1.0});
  }
  std::shuffle(edges.begin(), edges.end(), *random);
  return edges;
}

/// Longest way from a node without predecessors, by recursion.
uint32_t depth(const TaskGraph& graph, uint32_t node)
{
  uint32_t deepest = 0;
  for (const TaskGraph::Link& link : graph.predecessors(node))
  {
    deepest = std::max(deepest, depth(graph, link.node) + 1);
  }
  return deepest;
}

TEST(TaskGraph, CanBeEmpty)
{
  const TaskGraph graph;
  EXPECT_EQ(0U, graph.nodes());
  EXPECT_EQ(0U, graph.edges());
  EXPECT_EQ(0U, graph.levels());
  EXPECT_TRUE(graph.topologicalOrder().empty());
}

TEST(TaskGraph, ListsNeighboursInTheOrderOfTheEdges)
{
  const TaskGraph graph(4, {{2, 3, 30.0}, {0, 3, 10.0}, {1, 3, 20.0}, {0, 1, 0.0}});
  EXPECT_EQ(4U, graph.nodes());
  EXPECT_EQ(4U, graph.edges());
  EXPECT_EQ((std::vector<uint32_t>{2, 0, 1}), nodesOf(graph.predecessors(3)));
  EXPECT_EQ((std::vector<uint32_t>{3, 1}), nodesOf(graph.successors(0)));
  EXPECT_TRUE(graph.predecessors(0).empty());
  EXPECT_TRUE(graph.successors(3).empty());
  EXPECT_EQ(1U, graph.predecessors(1).size());
  EXPECT_EQ(30.0, graph.predecessors(3).begin()->bytes);
  EXPECT_EQ(10.0, graph.successors(0).begin()->bytes);
}

TEST(TaskGraph, TakesUnconnectedNodesAsOneLevelInTheirOrder)
{
  const TaskGraph graph(3, {});
  EXPECT_EQ(1U, graph.levels());
  EXPECT_EQ((std::vector<uint32_t>{0, 1, 2}), graph.topologicalOrder());
}

TEST(TaskGraph, OrdersAChainGivenBackwards)
{
  const TaskGraph graph(4, {{1, 0}, {2, 1}, {3, 2}});
  EXPECT_EQ((std::vector<uint32_t>{3, 2, 1, 0}), graph.topologicalOrder());
  EXPECT_EQ(4U, graph.levels());
  EXPECT_EQ(3U, graph.level(0));
  EXPECT_EQ(0U, graph.level(3));
}

TEST(TaskGraph, PutsANodeBelowItsDeepestPredecessor)
{
  const TaskGraph graph(4, {{0, 3}, {0, 1}, {1, 2}, {2, 3}});  // 0 -> 3 is a short cut
  EXPECT_EQ(3U, graph.level(3));
}

TEST(TaskGraph, OrdersRandomGraphsLevelByLevel)
{
  std::mt19937_64 random(7);
  for (int round = 0; round < 100; ++round)
  {
    const TaskGraph graph(12, randomEdges(12, 18, &random));
    std::vector<uint32_t> place(graph.nodes(), graph.nodes());
    for (uint32_t i = 0; i < graph.nodes(); ++i)
    {
      const uint32_t node = graph.topologicalOrder()[i];
      ASSERT_EQ(graph.nodes(), place[node]) << "listed twice";
      place[node] = i;
      ASSERT_EQ(depth(graph, node), graph.level(node));
      if (i > 0)
      {
        ASSERT_GE(graph.level(node), graph.level(graph.topologicalOrder()[i - 1]));
      }
      for (const TaskGraph::Link& link : graph.predecessors(node))
      {
        ASSERT_LT(place[link.node], i);
      }
    }
  }
}

TEST(TaskGraph, HoldsThousandsOfNodes)
{
  std::mt19937_64 random(8);
  const TaskGraph graph(5000, randomEdges(5000, 20000, &random));
  EXPECT_EQ(20000U, graph.edges());
  std::size_t successors = 0;
  for (uint32_t node = 0; node < graph.nodes(); ++node)
  {
    successors += graph.successors(node).size();
    for (const TaskGraph::Link& link : graph.predecessors(node))
    {
      ASSERT_LT(graph.level(link.node), graph.level(node));
    }
  }
  EXPECT_EQ(20000U, successors);
}

TEST(TaskGraph, NamesTheNodesOfACycleAndNoOthers)
{
  // 5 leads into the cycle, 6 and 7 hang below it: neither is part of it.
  const std::string text = refusal(8, {{5, 1}, {1, 4}, {4, 2}, {2, 1}, {4, 6}, {6, 7}, {0, 7}});
  EXPECT_NE(std::string::npos, text.find("1 -> 4 -> 2 -> 1")) << text;
  for (const char* other : {"0", "3", "5", "6", "7"})
  {
    EXPECT_EQ(std::string::npos, text.find(other)) << text;
  }
}

TEST(TaskGraph, NamesACycleOfTwo)
{
  const std::string text = refusal(2, {{0, 1}, {1, 0}});
  EXPECT_NE(std::string::npos, text.find("0 -> 1 -> 0")) << text;
}

TEST(TaskGraph, RefusesAnEdgeFromANodeToItself)
{
  const std::string text = refusal(3, {{0, 1}, {2, 2}});
  EXPECT_NE(std::string::npos, text.find("2 -> 2")) << text;
}

TEST(TaskGraph, RefusesUnknownNodes)
{
  EXPECT_NE(std::string::npos, refusal(3, {{0, 3}}).find("0 -> 3"));
  EXPECT_NE(std::string::npos, refusal(3, {{4, 1}}).find("4 -> 1"));
  EXPECT_NE(std::string::npos, refusal(0, {{0, 1}}).find("no nodes"));
}

TEST(TaskGraph, RefusesAnEdgeGivenTwice)
{
  const std::string text = refusal(3, {{0, 1, 5.0}, {1, 2}, {0, 1, 7.0}});
  EXPECT_NE(std::string::npos, text.find("0 -> 1 is given twice")) << text;
}

TEST(TaskGraph, RefusesImpossibleBytes)
{
  for (const double bytes : {-1.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
  {
    const std::string text = refusal(2, {{0, 1, bytes}});
    EXPECT_NE(std::string::npos, text.find("0 -> 1")) << text;
  }
}

}  // namespace
}  // namespace pi_runtime
