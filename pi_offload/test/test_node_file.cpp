#include <gtest/gtest.h>
#include "engine/node_file.h"
#include <pi_node/test_support/temporary_folder.h>

#include <cmath>
#include <stdexcept>

namespace pi_offload
{
namespace
{

using pi_node::test_support::TemporaryFolder;

/// What is said of a file, without its path.
std::string refusal(const std::string& yaml)
{
  const TemporaryFolder folder;
  const std::string path = folder.file("nodes.yaml", yaml);
  try
  {
    loadNodeFile(path);
  }
  catch (const std::runtime_error& error)
  {
    const std::string text = error.what();
    return text.rfind(path + ": ", 0) == 0 ? text.substr(path.size() + 2) : "no path: " + text;
  }
  return "";
}

TEST(NodeFile, ReadsTheExample)
{
  const std::vector<NodeDescription> nodes = loadNodeFile(PI_OFFLOAD_CONFIG "/edge_nodes.yaml");
  ASSERT_EQ(3u, nodes.size());
  EXPECT_EQ("gate", nodes[0].id);
  EXPECT_EQ("10.0.0.11:5680", nodes[0].address);
  EXPECT_EQ(100.0, nodes[0].range_m);
  EXPECT_EQ(3.0, nodes[0].frequency_ghz);
  EXPECT_EQ(180.0, nodes[1].position.x);
  EXPECT_EQ(25.0, nodes[1].position.y);
  EXPECT_EQ(NodeDescription().frequency_ghz, nodes[1].frequency_ghz);
  EXPECT_TRUE(std::isinf(nodes[2].range_m));
}

TEST(NodeFile, NamesNodeKeyAndValue)
{
  EXPECT_EQ("node 2: range = far, must be a number [m]",
            refusal("nodes: [{id: a, address: 'h:1'}, {id: b, address: 'h:2', range: far}]"));
  EXPECT_EQ("node 1: key adress means nothing here; there are id, address, x, y, range and frequency_ghz",
            refusal("nodes: [{id: a, adress: 'h:1'}]"));
  EXPECT_EQ("node 1: x = [1, 2], must be a number [m]", refusal("nodes: [{id: a, x: [1, 2]}]"));
  EXPECT_EQ("node 1: = 7, must be a map with id, address, x, y and range", refusal("nodes: [7]"));
  EXPECT_EQ("id a comes twice, must be unique", refusal("nodes: [{id: a, address: 'h:1'}, {id: a, address: 'h:2'}]"));
  EXPECT_EQ("there is no list nodes", refusal("edges: []"));
  EXPECT_EQ("there is no list nodes", refusal(""));
  EXPECT_NE("", refusal("nodes: [{id: 'a b', address: 'h:1'}]"));
  EXPECT_NE("", refusal("nodes: [{id: a, address: 'h'}]"));
  EXPECT_NE("", refusal("nodes: [{id: a, address: 'h:1', range: -5}]"));
  EXPECT_NE("", refusal("nodes: [{"));
}

TEST(NodeFile, NamesAFileThatIsNotThere)
{
  try
  {
    loadNodeFile("/no/such/file.yaml");
    FAIL();
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_STREQ("/no/such/file.yaml: cannot be read; it must be a YAML file with a list nodes", error.what());
  }
}

}  // namespace
}  // namespace pi_offload
