#include "vehicle/scenario.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <stdexcept>
#include <string>

namespace pi_simulation
{
namespace
{

const std::string GOOD = R"(
name: test
road: [[0, 0], [50, 0]]
start: [5, 0, 0]
goal: [40, 0, 0]
)";

std::string refusal(const std::string& more)
{
  try
  {
    Scenario::parse(GOOD + more, "a.yaml", 1);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

TEST(Scenario, ReadsAllOfIt)
{
  const Scenario scenario = Scenario::parse(GOOD + R"(
world_seed: 7
waypoints: [[20, 1]]
actors:
  - {id: child, class: person, path: [[30, -4], [30, 4]], trigger: {near: [30, 0], within: 12}, pauses: [{at: 4, for: 3}]}
  - {id: crate, class: box, path: [[20, 0]], size: [0.5, 0.6, 0.7], vanish_after: 5}
spoken:
  - {clip: stop_1, text: stop, time: 3}
  - {clip: go_1, text: go, near: [20, 0], within: 2, delay: 4}
edge_nodes: [{id: gate, x: 10, y: 5, range: 30}]
faults: [{time: 4, command: camera both dark, for: 2, end: camera both on}]
)",
                                            "a.yaml", 1);
  EXPECT_EQ("test", scenario.name);
  EXPECT_EQ(7u, scenario.world_seed);
  EXPECT_EQ(51u, scenario.road.size());  // every metre
  EXPECT_EQ(40.0, scenario.goal.x);
  ASSERT_EQ(2u, scenario.actors.size());
  EXPECT_EQ(12.0, scenario.actors[0].trigger.within);
  EXPECT_EQ(4.0, scenario.actors[0].pauses.at(0).at);
  EXPECT_EQ(0.6, scenario.actors[1].size.y());
  EXPECT_EQ(5.0, scenario.actors[1].vanish_after.value());
  ASSERT_EQ(2u, scenario.spoken.size());
  EXPECT_EQ(3.0, scenario.spoken[0].time.value());
  EXPECT_EQ(4.0, scenario.spoken[1].delay);
  EXPECT_EQ(30.0, scenario.edge_nodes.at(0).range);
  EXPECT_EQ("camera both on", scenario.faults.at(0).end);
  EXPECT_TRUE(contains(scenario.toJson(pi_vehicle::Pose2{-5.0, 0.0, 0.0}), "\"goal\":[35.0,0.0,0.0]"));
}

TEST(Scenario, ReadsWhatTheVehicleMeets)
{
  const Scenario scenario = Scenario::parse(GOOD + R"(
further_goals: [[45, 0, 0], [48, 1, 0.5]]
expect: stop
light: 0.25
picture_noise: 3
background: {sound: wind, level_dbfs: -30}
actors: [{id: late, class: person, path: [[30, -4], [30, 4]], trigger: {time: 9, near: [30, 0], within: 12}}]
faults:
  - {near: [20, 0], within: 5, command: radio off, end: radio on}
  - {time: 3, near: [30, 0], within: 2, command: kill /vio}
)",
                                            "a.yaml", 1);
  ASSERT_EQ(2u, scenario.further_goals.size());
  EXPECT_EQ(0.5, scenario.further_goals[1].heading);
  EXPECT_EQ("stop", scenario.expect);
  EXPECT_EQ(9.0, scenario.actors[0].trigger.time.value());
  EXPECT_EQ(12.0, scenario.actors[0].trigger.within);
  EXPECT_EQ("radio on", scenario.faults[0].end);
  EXPECT_EQ(3.0, scenario.faults[1].time);
  const StereoRendererOptions usual;
  const StereoRendererOptions pictures = scenario.pictures(usual);
  EXPECT_DOUBLE_EQ(0.25 * usual.brightness, pictures.brightness);
  EXPECT_DOUBLE_EQ(3.0 * usual.read_noise, pictures.read_noise);
  EXPECT_DOUBLE_EQ(9.0 * usual.shot_noise, pictures.shot_noise);
  const std::string json = scenario.toJson(pi_vehicle::Pose2{-5.0, 0.0, 0.0});
  EXPECT_TRUE(contains(json, "\"further_goals\":[[40.0,0.0,0.0],[43.0,1.0,0.5]]")) << json;
  EXPECT_TRUE(contains(json, "\"expect\":\"stop\"")) << json;
}

TEST(Scenario, TheOnesThatComeWithThePackageAreGood)
{
  size_t count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(std::string(CONFIG_DIR) + "/scenarios"))
  {
    if (entry.is_directory())
    {
      continue;
    }
    const Scenario scenario = Scenario::load(entry.path(), 1);
    EXPECT_EQ(entry.path().stem(), scenario.name);
    EXPECT_TRUE(scenario.name.find("crossing") == std::string::npos || !scenario.actors.empty()) << scenario.name;
    ++count;
  }
  EXPECT_EQ(count, 43u);
  EXPECT_GE(Scenario::load(std::string(CONFIG_DIR) + "/scenarios/campus_drive.yaml", 1).actors.size(), 2u);
}

TEST(Scenario, TheSeedDecidesWithinTheRanges)
{
  const std::string text = GOOD + R"(
actors: [{id: child, class: person, path: [[30, -4], [30, 4]], speed: 1.0, vary: {x: 3, speed: 0.2}}]
)";
  const auto first = Scenario::parse(text, "a.yaml", 1).actors[0];
  const auto again = Scenario::parse(text, "a.yaml", 1).actors[0];
  const auto other = Scenario::parse(text, "a.yaml", 2).actors[0];
  EXPECT_EQ(first.path[0], again.path[0]);
  EXPECT_NE(first.path[0].x(), other.path[0].x());
  for (uint64_t seed = 0; seed < 100; ++seed)
  {
    const auto actor = Scenario::parse(text, "a.yaml", seed).actors[0];
    EXPECT_NEAR(30.0, actor.path[0].x(), 3.0);
    EXPECT_EQ(-4.0, actor.path[0].y());
    EXPECT_NEAR(1.0, actor.speed, 0.2 + 1e-9);
  }
}

TEST(Scenario, NamesWhatIsWrongAndWhatIsKnown)
{
  const std::string unknown = refusal("gaol: [1, 2, 3]\n");
  EXPECT_TRUE(contains(unknown, "a.yaml: gaol means nothing here; known are")) << unknown;
  EXPECT_TRUE(contains(unknown, "goal")) << unknown;
  EXPECT_TRUE(contains(unknown, "edge_nodes")) << unknown;
  EXPECT_TRUE(contains(refusal("actors: [{id: a, class: dragon, path: [[1, 2]]}]"),
                       "actors/0/class = dragon, must be box, car, cart, cone, cyclist, kerb, person"));
  EXPECT_TRUE(contains(refusal("actors: [{id: a, class: person, path: [[1, 2]], jump: 1}]"),
                       "actors/0/jump means nothing here"));
  EXPECT_TRUE(contains(refusal("actors: [{id: a, class: person, path: [[1, 2]]}, {id: a, class: box, path: [[1, 3]]}]"),
                       "(two of id a)"));
  EXPECT_TRUE(contains(refusal("actors: [{id: a, class: person, path: [[1, 2]], speed: 99}]"),
                       "actors/0/speed = 99, must be in [0.05, 15]"));
  EXPECT_TRUE(contains(refusal("actors: [{id: a, class: person, path: []}]"), "actors/0/path = (no list)"));
  EXPECT_TRUE(contains(refusal("actors: [{id: a, class: person, path: [[1, 2]], trigger: {within: 3}}]"),
                       "must be given together with near"));
  EXPECT_TRUE(contains(refusal("spoken: [{clip: stop}]"), "must be given, or near, but not both"));
  EXPECT_TRUE(contains(refusal("faults: [{time: 1, command: unplug, for: 2}]"), "faults/0/end"));
  EXPECT_TRUE(contains(refusal("faults: [{time: 1, command: unplug, end: plug}]"), "faults/0/end"));
  EXPECT_TRUE(contains(refusal("faults: [{command: unplug}]"), "faults/0/time is missing"));
  EXPECT_TRUE(contains(refusal("faults: [{time: 1, command: explode}]"), "faults/0/command = \"explode\", must be a"));
  EXPECT_TRUE(contains(refusal("faults: [{time: 1, command: radio maybe}]"), "kill NODE, or radio on|off"));
  EXPECT_TRUE(contains(refusal("expect: fly"), "expect = fly, must be reach, refuse or stop"));
  EXPECT_TRUE(contains(refusal("expect: refuse"), "reason = (missing), must be part of what the vehicle says why"));
  EXPECT_TRUE(contains(refusal("reason: dark"), "reason"));
  EXPECT_TRUE(contains(refusal("light: 0"), "light = 0, must be in [0.01, 1]"));
  EXPECT_TRUE(contains(refusal("background: {level_dbfs: -30}"), "background/sound"));
  EXPECT_TRUE(contains(refusal("background: {sound: rain}"), "background/sound = rain, must be white, pink, wind, or"));
  EXPECT_TRUE(contains(refusal("further_goals: [[1, 2]]"), "must be a list of poses"));
  EXPECT_TRUE(contains(refusal("actors: [{id: a, class: person, path: [[1, 2]], trigger: {command: true, time: 1}}]"),
                       "actors/0/trigger = (command with time or near)"));
  EXPECT_TRUE(contains(refusal("bumps: much"), "a.yaml: bumps = \"much\", must be a number"));
  EXPECT_THROW(Scenario::parse("name: x", "b.yaml", 1), std::invalid_argument);
  EXPECT_THROW(Scenario::load("/nowhere.yaml", 1), std::invalid_argument);
}

}  // namespace
}  // namespace pi_simulation
