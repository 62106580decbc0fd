// config/coordinator.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>

#include <cmath>
#include <string>

#include "ros/coordinator_ros_options.h"

namespace pi_offload
{

using namespace pi_node::test_support;
namespace
{

const OptionsReader<CoordinatorRosOptions> coordinator_reader("/coordinator/");

TEST(CoordinatorRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  coordinator_reader.expectDefaultsOf(COORDINATOR_YAML);
}

TEST(CoordinatorRosOptions, ParametersComeBackAsTheyWere)
{
  CoordinatorRosOptions options;
  options.vehicle = "van_3";
  options.nodes = {{"a", "h:1", {1.0, 2.0}, 50.0, 3.0, 0.0}, {"b", "h:2", {0.0, 0.0}, INFINITY, 10.0, 0.0}};
  options.nodes_file = "/a/map.yaml";
  options.battery.eta_full = 0.75;
  options.client.encoder.mode = PictureMode::JPEG;
  options.client.engine.policy_name = "deadline";
  options.client.engine.policy.miss_cost_j = 5.0;
  options.client.engine.radio.tail_s = 0.25;
  options.keep_order = false;
  options.detection_local_s = 0.25;
  Names unknown;
  const CoordinatorRosOptions again = CoordinatorRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(Names(), unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(CoordinatorRosOptions().toText(), again.toText());
  ASSERT_EQ(2u, again.nodes.size());
  EXPECT_EQ(50.0, again.nodes[0].range_m);
  EXPECT_EQ(2.0, again.nodes[0].position.y);
  EXPECT_TRUE(std::isinf(again.nodes[1].range_m));
  EXPECT_EQ(PictureMode::JPEG, again.client.encoder.mode);
}

TEST(CoordinatorRosOptions, ReadsNodes)
{
  const CoordinatorRosOptions options =
      coordinator_reader.load("nodes: [{id: a, address: 'h:1', x: 3, y: 4.5, range: 60}, {id: b, address: 'h:2'}]");
  ASSERT_EQ(2u, options.nodes.size());
  EXPECT_EQ(3.0, options.nodes[0].position.x);
  EXPECT_EQ(60.0, options.nodes[0].range_m);
  EXPECT_EQ(NodeDescription().frequency_ghz, options.nodes[0].frequency_ghz);
  EXPECT_TRUE(std::isinf(options.nodes[1].range_m));
}

TEST(CoordinatorRosOptions, NamesUnknownParameters)
{
  Names unknown;
  coordinator_reader.load("{policy: {nam: local}, deadline: 0.3}", &unknown);
  EXPECT_EQ((Names{"/coordinator/deadline", "/coordinator/policy/nam"}), unknown);
}

TEST(CoordinatorRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ("parameter /coordinator/picture/encoding = \"png\", must be auto, jpeg or raw",
            coordinator_reader.refusal("picture: {encoding: png}"));
  EXPECT_EQ(
      "parameter /coordinator/policy/name = \"best\", must be one of local, nearest, nearest_anywhere, "
      "paper_literal, paper, deadline, expected_cost",
      coordinator_reader.refusal("policy: {name: best}"));
  EXPECT_EQ("parameter /coordinator/eta = 1.5, must be in [0, 1]", coordinator_reader.refusal("eta: 1.5"));
  EXPECT_EQ("parameter /coordinator/detection/deadline_s = 0, must be in [0.001, 60]",
            coordinator_reader.refusal("detection: {deadline_s: 0}"));
  EXPECT_EQ("parameter /coordinator/detection/local_s = -1, must be in [0.0001, 60]",
            coordinator_reader.refusal("detection: {local_s: -1}"));
  EXPECT_EQ("parameter /coordinator/battery/charge_full = 0.1, must be above charge_empty",
            coordinator_reader.refusal("battery: {charge_full: 0.1}"));
  EXPECT_EQ(
      "parameter /coordinator/nodes_file = \"map.yaml\", must be an absolute path, or empty for none: a node's "
      "working folder is not its user's",
      coordinator_reader.refusal("nodes_file: map.yaml"));
  EXPECT_EQ("parameter /coordinator/nodes node 1: range = \"far\", must be a number [m], or inf",
            coordinator_reader.refusal("nodes: [{id: a, address: 'h:1', range: far}]"));
  EXPECT_EQ(
      "parameter /coordinator/nodes node 1: port means nothing here; there are id, address, x, y, range and "
      "frequency_ghz",
      coordinator_reader.refusal("nodes: [{id: a, port: 5}]"));
  EXPECT_EQ("parameter /coordinator/nodes = 5, must be a list of maps with id, address, x, y and range",
            coordinator_reader.refusal("nodes: 5"));
  EXPECT_EQ("parameter /coordinator/nodes: address = \"\" of a, must be host:port",
            coordinator_reader.refusal("nodes: [{id: a}]"));
  EXPECT_EQ("parameter /coordinator/nodes: id a comes twice, must be unique",
            coordinator_reader.refusal("nodes: [{id: a, address: 'h:1'}, {id: a, address: 'h:2'}]"));
  EXPECT_PRED2(begins, coordinator_reader.refusal("policy: {hysteresis: -1}"),
               "parameter /coordinator/policy/hysteresis = -1, must be ");
  EXPECT_PRED2(begins, coordinator_reader.refusal("computer: {frequency_ghz: 0}"),
               "parameter /coordinator/computer/frequency_ghz = 0");
  EXPECT_PRED2(begins, coordinator_reader.refusal("radio: {tail_s: -2}"), "parameter /coordinator/radio/tail_s = -2");
  EXPECT_PRED2(begins, coordinator_reader.refusal("estimates: {memory_s: 0}"),
               "parameter /coordinator/estimates/memory_s = 0");
  EXPECT_PRED2(begins, coordinator_reader.refusal("probes: {period_s: 0}"),
               "parameter /coordinator/probes/period_s = 0");
  EXPECT_PRED2(begins, coordinator_reader.refusal("local: {max_waiting: 0}"),
               "parameter /coordinator/local/max_waiting = 0");
  EXPECT_PRED2(begins, coordinator_reader.refusal("keep_order: 1"),
               "parameter /coordinator/keep_order = 1, must be true or false");
  EXPECT_PRED2(begins, coordinator_reader.refusal("trusted_interfaces: [wg0, '*']"),
               "parameter /coordinator/trusted_interfaces = \"*\", must be names of interfaces, as wg0");
  EXPECT_PRED2(begins, coordinator_reader.refusal("trusted_interfaces: wg0"),
               "parameter /coordinator/trusted_interfaces = wg0, must be a list of texts");
  EXPECT_PRED2(begins, coordinator_reader.refusal("map_frame: ''"),
               "parameter /coordinator/map_frame = \"\", must be the name");
}

TEST(CoordinatorRosOptions, EtaFollowsTheBattery)
{
  BatteryOptions battery;
  battery.eta_full = 0.9;
  battery.eta_empty = 0.1;
  battery.charge_full = 0.8;
  battery.charge_empty = 0.2;
  EXPECT_DOUBLE_EQ(0.9, battery.eta(1.0));
  EXPECT_DOUBLE_EQ(0.9, battery.eta(0.8));
  EXPECT_DOUBLE_EQ(0.5, battery.eta(0.5));
  EXPECT_DOUBLE_EQ(0.1, battery.eta(0.2));
  EXPECT_DOUBLE_EQ(0.1, battery.eta(0.0));
}

TEST(CoordinatorRosOptions, WorkFollowsFromTheTimeOnTheVehicle)
{
  CoordinatorRosOptions options;
  options.detection_local_s = 0.09;
  options.speech_local_s = 0.3;
  options.client.engine.computer.frequency_ghz = 2.0;
  const OffloadClientOptions client = options.clientOptions("van");
  EXPECT_EQ("van", client.vehicle);
  EXPECT_DOUBLE_EQ(0.09, localCost(client.engine.needs[0], client.engine.computer).time_s);
  EXPECT_DOUBLE_EQ(0.3, localCost(client.engine.needs[1], client.engine.computer).time_s);
  options.vehicle = "bus";
  EXPECT_EQ("bus", options.clientOptions("van").vehicle);
}

}  // namespace
}  // namespace pi_offload
