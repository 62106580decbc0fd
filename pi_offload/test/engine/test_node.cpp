#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "engine/node.h"

namespace
{

using namespace pi_offload;

NodeDescription goodNode()
{
  NodeDescription node;
  node.id = "gate-3.north_a";
  node.address = "10.0.0.7:5560";
  node.position = {12.0, -4.0};
  node.range_m = 80.0;
  node.capacity_gcycles = 20.0;
  return node;
}

/// What the error says; empty if there is none.
std::string nodeError(const NodeDescription& node)
{
  try
  {
    node.validate();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(TaskKind, NamesAreReadBack)
{
  for (size_t i = 0; i < TASK_KINDS; ++i)
  {
    const auto kind = static_cast<TaskKind>(i);
    EXPECT_EQ(parseTaskKind(toString(kind)), kind);
  }
  EXPECT_STREQ(toString(static_cast<TaskKind>(200)), "unknown") << "as it may come over the network";
}

TEST(TaskKind, AnUnknownNameIsNamedWithWhatIsAllowed)
{
  try
  {
    parseTaskKind("slam");
    FAIL() << "slam is never offloaded";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(), "task kind \"slam\" is not known, must be detection or speech");
  }
  EXPECT_THROW(parseTaskKind(""), std::invalid_argument);
  EXPECT_THROW(parseTaskKind("Detection"), std::invalid_argument);
}

TEST(NodeDescription, GoodOnesAreTaken)
{
  NodeDescription node = goodNode();
  EXPECT_EQ(nodeError(node), "");
  node.address = "";
  EXPECT_EQ(nodeError(node), "") << "simulated nodes have none";
  node.range_m = std::numeric_limits<double>::infinity();
  EXPECT_EQ(nodeError(node), "") << "everywhere";
  for (const char* address : {"edge.example.org:1", "localhost:65535", "[::1]:5560"})
  {
    node.address = address;
    EXPECT_EQ(nodeError(node), "") << address;
  }
}

TEST(NodeDescription, IdsAreShortAndPlain)
{
  NodeDescription node = goodNode();
  for (const std::string& id : {std::string(), std::string("a b"), std::string("a/b"), std::string("a\nb"),
                                std::string("\xc3\xa4"), std::string(65, 'a')})
  {
    node.id = id;
    EXPECT_NE(nodeError(node).find("node id \"" + id + "\" must be"), std::string::npos) << id;
  }
  node.id = std::string(64, 'a');
  EXPECT_EQ(nodeError(node), "");
}

TEST(NodeDescription, AddressesHaveHostAndPort)
{
  NodeDescription node = goodNode();
  for (const char* address : {"host", "host:", ":5560", "host:0", "host:65536", "host:-1", "host:55x", "host:999999",
                              "a b:5560", "::1:5560", "tcp://host:5560", "[]:5560"})
  {
    node.address = address;
    EXPECT_EQ(nodeError(node),
              "node gate-3.north_a/address = \"" + std::string(address) + "\", must be host:port, port in [1, 65535]");
  }
}

TEST(NodeDescription, NumbersNameNodeFieldAndBound)
{
  NodeDescription node = goodNode();
  node.range_m = -1.0;
  EXPECT_EQ(nodeError(node), "node gate-3.north_a/range_m = -1, must be in [0, inf]");
  node.range_m = std::nan("");
  EXPECT_NE(nodeError(node).find("range_m = nan"), std::string::npos);
  node = goodNode();
  node.frequency_ghz = 0.0;
  EXPECT_EQ(nodeError(node), "node gate-3.north_a/frequency_ghz = 0, must be positive");
  node = goodNode();
  node.capacity_gcycles = -2.0;
  EXPECT_NE(nodeError(node).find("capacity_gcycles = -2"), std::string::npos);
  node = goodNode();
  node.position.y = std::numeric_limits<double>::infinity();
  EXPECT_NE(nodeError(node).find("position = (12.000000, inf), must be finite"), std::string::npos);
}

}  // namespace
