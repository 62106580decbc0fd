#include "master/parameter_tree.h"

#include <gtest/gtest.h>

#include <string>
#include <tuple>
#include <vector>

#include "master/graph_name.h"

namespace pi_os_transport
{
namespace
{

using Struct = RpcValue::Struct;

TEST(GraphName, ResolvesAsRosgraphDoes)
{
  EXPECT_EQ("/a/b", resolveName("/a//b/", "/ns/node"));
  EXPECT_EQ("/ns/a/b", resolveName("a/b/", "/ns/node"));
  EXPECT_EQ("/ns/node/a", resolveName("~a", "/ns/node"));
  EXPECT_EQ("/ns/node/a", resolveName("~/a", "/ns/node"));
  EXPECT_EQ("/ns/", resolveName("", "/ns/node"));
  EXPECT_EQ("/a", resolveName("a", "/node"));
  EXPECT_EQ("/a", resolveName("a", ""));
  EXPECT_EQ("/", resolveName("//", "/node"));
  EXPECT_EQ("/ns/", namespaceOf("/ns/node/"));
  EXPECT_EQ("/b", joinName("/a", "/b"));
  EXPECT_EQ("~b", joinName("~", "b"));
}

TEST(ParameterTree, KeepsValuesBelowNamespaces)
{
  ParameterTree tree;
  EXPECT_EQ(ParameterTree::SetResult::DONE, tree.set("/a/b/c", 1));
  EXPECT_EQ(ParameterTree::SetResult::DONE, tree.set("/a//d/", "x"));
  ASSERT_NE(nullptr, tree.get("/a/b/c"));
  EXPECT_EQ(RpcValue(1), *tree.get("/a/b/c"));
  EXPECT_EQ(RpcValue(Struct{{"b", Struct{{"c", 1}}}, {"d", "x"}}), *tree.get("/a"));
  EXPECT_EQ(nullptr, tree.get("/a/b/c/below"));
  EXPECT_EQ(nullptr, tree.get("/b"));
  EXPECT_EQ((RpcValue::Array{"/a/b/c", "/a/d"}), tree.names());
}

TEST(ParameterTree, ReplacesValuesByNamespacesAndBack)
{
  ParameterTree tree;
  tree.set("/a", 1);
  tree.set("/a/b", 2);
  EXPECT_EQ(RpcValue(Struct{{"b", 2}}), *tree.get("/a"));
  tree.set("/a", Struct{{"c", 3}});
  EXPECT_EQ(nullptr, tree.get("/a/b"));
  EXPECT_EQ(RpcValue(3), *tree.get("/a/c"));
}

TEST(ParameterTree, GuardsItsRoot)
{
  ParameterTree tree;
  tree.set("/a", 1);
  EXPECT_EQ(ParameterTree::SetResult::ROOT_IS_NO_STRUCT, tree.set("/", 1));
  EXPECT_FALSE(tree.remove("/"));
  EXPECT_EQ(RpcValue(1), *tree.get("/a"));
  EXPECT_EQ(ParameterTree::SetResult::DONE, tree.set("/", Struct{{"b", 2}}));
  EXPECT_EQ(RpcValue(Struct{{"b", 2}}), *tree.get("/"));
}

TEST(ParameterTree, LimitsItsDepth)
{
  ParameterTree tree;
  std::string key;
  for (size_t level = 0; level < ParameterTree::MAX_DEPTH; ++level)
  {
    key += "/a";
  }
  EXPECT_EQ(ParameterTree::SetResult::TOO_DEEP, tree.set(key + "/a", 1));
  EXPECT_EQ(nullptr, tree.get("/a"));
  EXPECT_EQ(ParameterTree::SetResult::DONE, tree.set(key, 1));
  EXPECT_EQ((RpcValue::Array{key}), tree.names());
}

TEST(ParameterTree, RemovesWhatIsThere)
{
  ParameterTree tree;
  tree.set("/a/b", 1);
  EXPECT_FALSE(tree.remove("/a/c"));
  EXPECT_FALSE(tree.remove("/a/b/c"));
  EXPECT_TRUE(tree.remove("/a/b"));
  EXPECT_EQ(RpcValue(Struct()), *tree.get("/a"));
  EXPECT_TRUE(tree.remove("/a"));
  EXPECT_TRUE(tree.names().empty());
}

TEST(ParameterTree, SearchesUpwardsForTheFirstPart)
{
  ParameterTree tree;
  tree.set("/robot/arm", 1);
  tree.set("/pr2/robot/base", 2);
  EXPECT_EQ("/pr2/robot", tree.search("/pr2/foo", "robot"));
  EXPECT_EQ("/pr2/robot/arm", tree.search("/pr2/foo", "robot/arm"));
  EXPECT_EQ("/robot", tree.search("/other/foo", "robot"));
  EXPECT_EQ("/robot", tree.search("/", "robot"));
  EXPECT_EQ("/robot", tree.search("/pr2/foo", "/robot"));
  EXPECT_EQ(std::nullopt, tree.search("/pr2/foo", "/nothing"));
  EXPECT_EQ(std::nullopt, tree.search("/pr2/foo", "nothing"));
}

using Told = std::vector<std::tuple<std::string, std::string, RpcValue>>;

Told told(const std::vector<std::string>& subscriptions, const std::string& key, const RpcValue& value)
{
  Told result;
  for (const ParameterUpdate& update : parameterUpdates(subscriptions, key, value))
  {
    result.emplace_back(update.subscription, update.key, *update.value);
  }
  return result;
}

TEST(ParameterUpdates, ReachTheKeyAndWhatLiesAbove)
{
  EXPECT_EQ((Told{{"/", "/a/b/", 1}, {"/a/", "/a/b/", 1}, {"/a/b/", "/a/b/", 1}}),
            told({"/", "/a/", "/a/b/", "/a/b/c/", "/a/bc/", "/x/"}, "/a/b", 1));
}

TEST(ParameterUpdates, ReachWhatAStructSetsOrUnsets)
{
  const RpcValue value = Struct{{"b", Struct{{"c", 1}}}};
  EXPECT_EQ((Told{{"/a/x/", "/a/x/", Struct()}, {"/a/b/", "/a/b/", Struct{{"c", 1}}}, {"/a/b/c/", "/a/b/c/", 1}}),
            told({"/a/b/", "/a/b/c/", "/a/x/"}, "/a", value));
}

TEST(ParameterUpdates, OfADeletedTreeReachAllOfIt)
{
  EXPECT_EQ((Told{{"/a/", "/a/", Struct()}, {"/a/b/", "/a/b/", Struct()}}), told({"/a/", "/a/b/"}, "/a", Struct()));
  EXPECT_TRUE(told({}, "/a", Struct()).empty());
}

TEST(ParameterUpdates, SkipTheAuthorOnlyAboveTheKey)
{
  const RpcValue value = Struct{{"b", 1}};
  const std::vector<ParameterUpdate> updates = parameterUpdates({"/a/", "/a/b/"}, "/a", value);
  ASSERT_EQ(2U, updates.size());
  EXPECT_TRUE(updates[0].by_others);
  EXPECT_FALSE(updates[1].by_others);
}

}  // namespace
}  // namespace pi_os_transport
