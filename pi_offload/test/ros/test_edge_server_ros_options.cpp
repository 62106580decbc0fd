// config/edge_server.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "ros/edge_server_ros_options.h"

namespace pi_offload
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<EdgeServerRosOptions> edge_server_reader("/edge_server/");

TEST(EdgeServerRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  edge_server_reader.expectDefaultsOf(EDGE_SERVER_YAML);
}

TEST(EdgeServerRosOptions, TheFileIsReadAsTheParametersAre)
{
  Names unknown;
  EXPECT_EQ(EdgeServerRosOptions().toText(), EdgeServerRosOptions::loadFile(EDGE_SERVER_YAML, &unknown).toText());
  EXPECT_EQ(Names(), unknown);
  const TemporaryFolder folder;
  const std::string file =
      folder.file("server.yaml", "{id: lamp, port: 0, range: 80, x: 3, admission: {workers: 4}, prot: 7}");
  const EdgeServerRosOptions options = EdgeServerRosOptions::loadFile(file, &unknown);
  EXPECT_EQ(Names{"prot"}, unknown);
  EXPECT_EQ("lamp", options.id);
  EXPECT_EQ(0, options.serverOptions().replier.port);
  EXPECT_EQ(80.0, options.serverOptions().range_m);
  EXPECT_EQ(3.0, options.serverOptions().position.x);
  EXPECT_EQ(4, options.serverOptions().admission.workers);
  EXPECT_EQ(EdgeServerRosOptions().toText(),
            EdgeServerRosOptions::loadFile(folder.file("empty.yaml", ""), &unknown).toText());
}

TEST(EdgeServerRosOptions, NamesFileKeyAndValue)
{
  const TemporaryFolder folder;
  const auto refusalOf = [&folder](const std::string& yaml)
  {
    const std::string file = folder.file("server.yaml", yaml);
    Names unknown;
    try
    {
      EdgeServerRosOptions::loadFile(file, &unknown);
    }
    catch (const std::runtime_error& error)
    {
      const std::string text = error.what();
      return begins(text, file + ": ") ? text.substr(file.size() + 2) : "no path: " + text;
    }
    return std::string();
  };
  EXPECT_EQ("parameter port = 70000, must be in [0, 65535]", refusalOf("port: 70000"));
  EXPECT_EQ("parameter port = far, must be a whole number", refusalOf("port: far"));
  EXPECT_EQ("is no map of parameters", refusalOf("[1, 2]"));
  EXPECT_NE("", refusalOf("a: {"));
  Names unknown;
  try
  {
    EdgeServerRosOptions::loadFile("/no/such/file.yaml", &unknown);
    FAIL();
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_STREQ("/no/such/file.yaml: cannot be read; config/edge_server.yaml shows what it should say", error.what());
  }
}

TEST(EdgeServerRosOptions, NamesParameterValueAndBound)
{
  EXPECT_PRED2(begins, edge_server_reader.refusal("admission: {workers: 0}"),
               "parameter /edge_server/admission/workers = 0, must be in ");
  EXPECT_EQ("parameter /edge_server/range = \"far\", must be a number [m], or inf",
            edge_server_reader.refusal("range: far"));
  EXPECT_EQ("parameter /edge_server/range = -1, must be at least 0", edge_server_reader.refusal("range: -1"));
  EXPECT_PRED2(begins, edge_server_reader.refusal("id: a b"), "parameter /edge_server/");
  EXPECT_PRED2(begins, edge_server_reader.refusal("address: somewhere"), "parameter /edge_server/");
  EXPECT_PRED2(begins, edge_server_reader.refusal("detection: {model: m.yaml}"),
               "parameter /edge_server/detection/model = \"m.yaml\", must be the name of a network or an absolute");
  EXPECT_EQ("parameter /edge_server/detection/target = \"gpu\", must be cpu, opencl or opencl_fp16",
            edge_server_reader.refusal("detection: {target: gpu}"));
  EXPECT_EQ("parameter /edge_server/speech/mode = \"open\", must be safe or closed",
            edge_server_reader.refusal("speech: {mode: open}"));
  EXPECT_EQ("parameter /edge_server/detection/enabled and speech/enabled = false, must be true for one at least",
            edge_server_reader.refusal("{detection: {enabled: false}, speech: {enabled: false}}"));
  EXPECT_PRED2(begins, edge_server_reader.refusal("trusted_interfaces: [a_name_that_is_too_long]"),
               "parameter /edge_server/trusted_interfaces = \"a_name_that_is_too_long\", must be names of interfaces");
  EXPECT_PRED2(begins, edge_server_reader.refusal("drain_s: -1"), "parameter /edge_server/drain_s = -1, must be in ");
  EXPECT_PRED2(begins, edge_server_reader.refusal("server: {max_payload_mb: 0}"),
               "parameter /edge_server/server/max_payload_mb = 0");
  EXPECT_PRED2(begins, edge_server_reader.refusal("health: {port: 99999}"),
               "parameter /edge_server/health/port = 99999");
}

TEST(EdgeServerRosOptions, TheAnnouncementSaysWhereVehiclesConnect)
{
  EdgeServerRosOptions options =
      edge_server_reader.load("{id: lamp, host: 10.0.0.7, x: 3, y: 4, range: 80, map_frame: town}");
  EdgeNode node = options.announcement(1234);
  EXPECT_EQ("lamp", node.id);
  EXPECT_EQ("10.0.0.7:1234", node.address);
  EXPECT_EQ("town", node.frame_id);
  EXPECT_EQ(3.0, node.x);
  EXPECT_EQ(4.0, node.y);
  EXPECT_EQ(80.0, node.range);
  options.address = "balancer:99";
  EXPECT_EQ("balancer:99", options.announcement(1234).address);
  options.address = "";
  options.server.replier.host = "fe80::1";
  EXPECT_EQ("[fe80::1]:1234", options.announcement(1234).address);
  options.server.replier.host = "0.0.0.0";
  options.id = "";
  node = options.announcement(1234);
  EXPECT_EQ(node.id + ":1234", node.address);  // the host's name
  EXPECT_TRUE(std::isinf(edge_server_reader.load("range: inf").announcement(1).range));
}

TEST(EdgeServerRosOptions, TheModelsNameIsKnownBeforehand)
{
  std::string notice;
  EXPECT_EQ("street", edge_server_reader.load("{detection: {model: street}}").detectionModel(&notice));
  EXPECT_EQ("", edge_server_reader.load("{detection: {enabled: false}}").detectionModel(&notice));
  EXPECT_EQ("", notice);
  for (const char* model : {"/no/model.yaml", "no_such_network"})
  {
    EXPECT_THROW(edge_server_reader.load(std::string("{detection: {model: ") + model + "}}").detectionModel(&notice),
                 std::runtime_error)
        << model;
  }
}

TEST(EdgeServerRosOptions, AFileOfCommandsThatIsNotThereIsNamed)
{
  const EdgeServerRosOptions options =
      edge_server_reader.load("{detection: {enabled: false}, speech: {commands: /no/commands.yaml}}");
  try
  {
    options.executors();
    FAIL();
  }
  catch (const std::exception& error)
  {
    EXPECT_NE(std::string::npos, std::string(error.what()).find("/no/commands.yaml")) << error.what();
  }
}

}  // namespace
}  // namespace pi_offload
