#include <pi_node/test_support/temporary_folder.h>

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "simulation/simulation.h"

using namespace pi_offload;

namespace
{

const char* const USUAL = R"(
route: [[0, 0], [100, 0], [100, 100]]
streams:
  - kind: detection
    deadline_s: 0.25
    input_bytes: 50000
nodes:
  - {id: a, position: [10, 20], range_m: 70, workers: 3, service_s: {detection: 0.03, speech: 0.2}}
)";

class ScenarioFile : public testing::Test
{
protected:
  std::string write(const std::string& yaml)
  {
    const std::string path = folder_.path() + "/world.yaml";
    std::ofstream(path) << yaml;
    return path;
  }
  std::string errorOf(const std::string& yaml)
  {
    const std::string path = write(yaml);
    try
    {
      Scenario::load_file(path);
    }
    catch (const std::runtime_error& error)
    {
      const std::string text = error.what();
      EXPECT_EQ(text.rfind(path + ": ", 0), 0U) << text;
      return text.substr(path.size() + 2);
    }
    return "no error";
  }

  pi_node::test_support::TemporaryFolder folder_;
};

TEST_F(ScenarioFile, ReadsWhatItSaysAndKeepsTheRest)
{
  const Scenario scenario = Scenario::load_file(write(USUAL));
  EXPECT_EQ(scenario.name, "world");
  EXPECT_EQ(scenario.route.size(), 3U);
  ASSERT_EQ(scenario.streams.size(), 1U);
  EXPECT_DOUBLE_EQ(scenario.streams[0].deadline_s, 0.25);
  EXPECT_DOUBLE_EQ(scenario.streams[0].local_s, Scenario::Stream().local_s);
  ASSERT_EQ(scenario.nodes.size(), 1U);
  EXPECT_EQ(scenario.nodes[0].description.id, "a");
  EXPECT_DOUBLE_EQ(scenario.nodes[0].description.position.y, 20.0);
  EXPECT_EQ(scenario.nodes[0].workers, 3);
  EXPECT_DOUBLE_EQ(scenario.nodes[0].service_s[1], 0.2);
  EXPECT_DOUBLE_EQ(scenario.network.loss, Scenario::Network().loss);
}

TEST_F(ScenarioFile, GivesTheEngineTheNeedsOfTheStreams)
{
  const Scenario scenario = Scenario::load_file(write(USUAL));
  const TaskNeeds& needs = scenario.engine.needs[static_cast<size_t>(TaskKind::DETECTION)];
  EXPECT_DOUBLE_EQ(needs.deadline_s, 0.25);
  EXPECT_NEAR(needs.input_mbit, 0.4, 1e-12);
  EXPECT_NEAR(needs.output_mbit, 0.008, 1e-12);
  EXPECT_NE(scenario.stream(TaskKind::DETECTION), nullptr);
  EXPECT_EQ(scenario.stream(TaskKind::SPEECH), nullptr);
}

TEST_F(ScenarioFile, ReadsEngineAdmissionLoadAndFailures)
{
  const Scenario scenario = Scenario::load_file(write(std::string(USUAL) + R"(
engine:
  policy: {miss_cost_j: 7}
  radio: {wait_w: 0.5}
  computer: {static_w: 2}
  probe_period_s: 0.3
admission: {max_queued: 9, max_queued_per_vehicle: 4, served: {speech: false}}
load: {heavy_share: 0.25, leases: false}
failures: {mean_between_s: 60}
)"));
  EXPECT_DOUBLE_EQ(scenario.engine.policy.miss_cost_j, 7.0);
  EXPECT_DOUBLE_EQ(scenario.engine.radio.wait_w, 0.5);
  EXPECT_DOUBLE_EQ(scenario.engine.computer.static_w, 2.0);
  EXPECT_DOUBLE_EQ(scenario.engine.probe_period_s, 0.3);
  EXPECT_EQ(scenario.admission.max_queued, 9U);
  EXPECT_TRUE(scenario.admission.served[0]);
  EXPECT_FALSE(scenario.admission.served[1]);
  EXPECT_DOUBLE_EQ(scenario.load.heavy_share, 0.25);
  EXPECT_FALSE(scenario.load.leases);
  EXPECT_DOUBLE_EQ(scenario.failures.mean_between_s, 60.0);
}

TEST_F(ScenarioFile, ErrorsNameKeyValueAndBound)
{
  EXPECT_EQ(errorOf(std::string(USUAL) + "speed: -1\n"), "speed = -1, must be in [0, 100]");
  EXPECT_EQ(errorOf(std::string(USUAL) + "speed: fast\n"), "speed = \"fast\", must be a number");
  EXPECT_EQ(errorOf(std::string(USUAL) + "speed: .nan\n"), "speed = nan, must be in [0, 100]");
  EXPECT_EQ(errorOf(std::string(USUAL) + "vehicles: 1.5\n"), "vehicles = \"1.5\", must be a whole number");
  EXPECT_EQ(errorOf(std::string(USUAL) + "network: {loss: 2}\n"), "network/loss = 2, must be in [0, 1]");
  EXPECT_EQ(errorOf(std::string(USUAL) + "load: {leases: 3}\n"), "load/leases = \"3\", must be true or false");
  EXPECT_EQ(errorOf(std::string(USUAL) + "admission: {max_queued: -3}\n"),
            "admission/max_queued = \"-3\", must be a whole number, at least 0");
  EXPECT_EQ(errorOf(std::string(USUAL) + "load: {task_s: 1}\n"),
            "load/task_s = 1.000000, must be within service_s of both kinds of nodes/a, [0.03, 0.2]");
}

TEST_F(ScenarioFile, UnknownKeysAreNamedWithThoseThatThereAre)
{
  EXPECT_EQ(errorOf(std::string(USUAL) + "failures: {mean_time_s: 1}\n"),
            "failures/mean_time_s means nothing here; known are mean_between_s, mean_repair_s");
}

TEST_F(ScenarioFile, MissingKeysAndWrongShapesAreNamed)
{
  EXPECT_EQ(errorOf("speed: 3\n"), "route is missing");
  EXPECT_EQ(errorOf("- 3\n"), "must be a map of fields");
  EXPECT_EQ(errorOf("route: [[0, 0], [1]]\n"), "route/1 must be a point [x, y]");
  EXPECT_EQ(errorOf("route: [[0, 0], [1, 1]]\nstreams: 3\n"), "streams must be a list");
  EXPECT_EQ(errorOf("route: [[0, 0], [1, 1]]\nstreams: []\nnodes: []\n"), "streams = [], must be at least one");
  EXPECT_EQ(errorOf("route: [[0, 0], [1, 1]]\nstreams: [{kind: speech}, {kind: speech}]\nnodes: []\n"),
            "streams/speech = given twice, must be given once");
  EXPECT_EQ(errorOf("route: [[0, 0], [1, 1]]\nstreams: [{kind: speech}]\nnodes: [{id: a, position: [0, 0]}]\n"),
            "nodes/0/range_m is missing");
  EXPECT_NE(errorOf("route: [[0, 0], [0, 0]]\nstreams: [{kind: speech}]\nnodes: []\n").find("must be positive"),
            std::string::npos);
}

TEST_F(ScenarioFile, NoYamlAndNoFileAreSaid)
{
  EXPECT_EQ(errorOf("route: [[0, 0\n").rfind("no YAML: ", 0), 0U);
  try
  {
    Scenario::load_file(folder_.path() + "/none.yaml");
    FAIL() << "no error";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_NE(std::string(error.what()).find("/none.yaml: there is no such file"), std::string::npos);
  }
}

TEST_F(ScenarioFile, DeepNestingAndAliasesDoNotCrash)
{
  EXPECT_NE(errorOf(std::string(200, '[')), "no error");
  EXPECT_NE(errorOf("route: &a [*a, *a]\n"), "no error");
}

TEST(Scenarios, ThoseOfThePackageAreValid)
{
  size_t count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PI_OFFLOAD_CONFIG "/scenarios"))
  {
    const Scenario scenario = Scenario::load_file(entry.path().string());
    EXPECT_EQ(scenario.name, entry.path().stem().string());
    ++count;
  }
  EXPECT_GE(count, 7U);
}

}  // namespace
