#include "decision/reaction_rules.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "test_values.h"

namespace
{

using namespace pi_vehicle;

ReactionRules engine(const std::string& rule)
{
  return ReactionRules(ReactionRulesOptions::parse("rules: [" + rule + "]", "r.yaml"));
}

const char* const GREET =
    "{name: hello, label: person, range: [0.5, 3], bearing: 0.6, min_score: 0.6, persistence: 1, cooldown: 20, "
    "action: greet}";

SeenThing person(int64_t id, double x, double y, double score = 0.9)
{
  return {id, "person", score, {x, y}};
}

/// Events of 10 Hz updates with the same things, in [from, to).
size_t events(ReactionRules& rules, int from_ms, int to_ms, const std::vector<SeenThing>& things)
{
  size_t count = 0;
  for (int t = from_ms; t < to_ms; t += 100)
  {
    count += rules.update(t * MS, things).events.size();
  }
  return count;
}

TEST(ReactionRules, GreetsAfterPersistenceOnceWhileThePersonStays)
{
  ReactionRules rules = engine(GREET);
  EXPECT_EQ(events(rules, 0, 1000, {person(7, 2.0, 0.0)}), 0U);
  const ReactionResult result = rules.update(1000 * MS, {person(7, 2.0, 0.0)});
  ASSERT_EQ(result.events.size(), 1U);
  EXPECT_EQ(result.events[0].rule, "hello");
  EXPECT_EQ(result.events[0].thing.id, 7);
  EXPECT_EQ(result.events[0].thing.label, "person");
  EXPECT_EQ(result.events[0].thing.position, Eigen::Vector2d(2.0, 0.0));
  EXPECT_EQ(result.events[0].action, ReactionAction::GREET);
  EXPECT_TRUE(std::isinf(result.speed_limit));
  EXPECT_EQ(events(rules, 1100, 60000, {person(7, 2.0, 0.0)}), 0U);
}

TEST(ReactionRules, AGreetingMayHaveItsOwnText)
{
  ReactionRules rules =
      engine("{name: a, label: person, range: [0, 3], persistence: 0, action: greet, text: good morning}");
  const ReactionResult result = rules.update(0, {person(7, 2.0, 0.0)});
  ASSERT_EQ(result.events.size(), 1U);
  EXPECT_EQ(result.events[0].text, "good morning");
}

TEST(ReactionRules, CooldownHoldsForOthersToo)
{
  ReactionRules rules = engine(GREET);
  EXPECT_EQ(events(rules, 0, 2000, {person(1, 2.0, 0.0)}), 1U);
  EXPECT_EQ(events(rules, 2000, 20900, {person(2, 2.0, 0.0)}), 0U);
  EXPECT_EQ(events(rules, 20900, 22500, {person(2, 2.0, 0.0)}), 1U);
}

TEST(ReactionRules, IgnoresOtherLabelsFaintOnesAndThoseOutsideOfTheZone)
{
  ReactionRules rules = engine(GREET);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(events(rules, 0, 5000,
                   {{1, "dog", 0.9, {2.0, 0.0}},
                    person(2, 2.0, 0.0, 0.5),
                    person(3, 4.0, 0.0),
                    person(4, 0.3, 0.0),
                    person(5, 1.0, 2.0),
                    person(6, nan, 0.0),
                    person(7, 2.0, 0.0, nan)}),
            0U);
}

TEST(ReactionRules, ShortGapsDoNotCountLongOnesDo)
{
  ReactionRules rules = engine(GREET);
  events(rules, 0, 600, {person(1, 2.0, 0.0)});
  events(rules, 600, 800, {});
  EXPECT_EQ(events(rules, 800, 1200, {person(1, 2.0, 0.0)}), 1U);
  ReactionRules other = engine(GREET);
  events(other, 0, 600, {person(1, 2.0, 0.0)});
  events(other, 600, 1000, {});
  EXPECT_EQ(events(other, 1000, 1900, {person(1, 2.0, 0.0)}), 0U);
}

TEST(ReactionRules, SlowHoldsAndEndsAfterHold)
{
  ReactionRules rules = engine(
      "{name: near, label: \"*\", polygon: [[0, -1], [4, -1], [4, 1], [0, 1]], persistence: 0.2, hold: 1, min_score: "
      "0, "
      "action: slow, speed: 0.8}");
  const std::vector<SeenThing> things = {{1, "", 0.0, {2.0, 0.5}}};
  EXPECT_TRUE(std::isinf(rules.update(0, things).speed_limit));
  rules.update(100 * MS, things);
  ReactionResult result = rules.update(200 * MS, things);
  EXPECT_EQ(result.speed_limit, 0.8);
  EXPECT_EQ(result.reason, "near");
  EXPECT_EQ(result.events.size(), 1U);
  EXPECT_EQ(rules.update(300 * MS, things).events.size(), 0U);
  for (int t = 400; t <= 1600; t += 100)
  {
    result = rules.update(t * MS, {});
  }
  EXPECT_EQ(result.speed_limit, 0.8) << "last believed in at 0.6 s, held until 1.6 s";
  EXPECT_TRUE(std::isinf(rules.update(1700 * MS, {}).speed_limit));
}

TEST(ReactionRules, TheLowestLimitWins)
{
  ReactionRules rules = engine(
      "{name: a, label: person, range: [0, 9], persistence: 0, action: slow, speed: 1},"
      "{name: b, label: person, range: [0, 3], persistence: 0, action: stop}");
  EXPECT_EQ(rules.update(0, {person(1, 5.0, 0.0)}).reason, "a");
  const ReactionResult result = rules.update(1, {person(1, 2.0, 0.0)});
  EXPECT_EQ(result.speed_limit, 0.0);
  EXPECT_EQ(result.reason, "b");
}

TEST(ReactionRules, AClockThatGoesBackBeginsAnew)
{
  ReactionRules rules = engine(GREET);
  EXPECT_EQ(events(rules, 100000, 102000, {person(1, 2.0, 0.0)}), 1U);
  EXPECT_EQ(events(rules, 0, 2000, {person(1, 2.0, 0.0)}), 1U);
}

TEST(ReactionRules, KnowsConcavePolygons)
{
  ReactionRule rule;
  rule.polygon = {{0.0, 0.0}, {4.0, 0.0}, {4.0, 4.0}, {2.0, 1.0}, {0.0, 4.0}};
  EXPECT_TRUE(ReactionRules::inZone(rule, {0.5, 2.0}));
  EXPECT_TRUE(ReactionRules::inZone(rule, {3.5, 2.0}));
  EXPECT_FALSE(ReactionRules::inZone(rule, {2.0, 2.0}));
  EXPECT_FALSE(ReactionRules::inZone(rule, {-1.0, 1.0}));
}

std::string errorOfRule(const std::string& rule)
{
  return pi_node::test_support::messageOf<std::invalid_argument>([&] { engine(rule); });
}

TEST(ReactionRulesOptions, ErrorsNameRuleFieldValueAndBound)
{
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [0, 3], action: dance}"),
            "r.yaml: rules/0/action = \"dance\", must be one of greet, horn, say, slow, stop");
  EXPECT_EQ(errorOfRule("{name: a, label: x, action: stop}"),
            "r.yaml: rules/0/polygon or range is missing, must be one of them");
  EXPECT_EQ(errorOfRule("{name: a, label: x, polygon: [[0, 0], [1, 1]], action: stop}"),
            "r.yaml: rules/a/polygon has 2 corners, must have at least 3");
  EXPECT_EQ(errorOfRule("{name: a, label: x, polygon: [[0, 0, 1]], action: stop}"),
            "r.yaml: rules/0/polygon = a corner of 3 numbers, must be a list of [x, y]");
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [4, 3], action: stop}"),
            "r.yaml: rules/a/min_range = 4, must be in [0, 3]");
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [0, 3], action: slow}"),
            "r.yaml: rules/a/speed = 0, must be in [0.05, 10]");
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [0, 3], action: say}"),
            "r.yaml: rules/a/text = \"\", must be given for say");
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [0, 3], action: stop, min_score: high}"),
            "r.yaml: rules/0/min_score = \"high\", must be a number");
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [0, 3], action: stop, min_score: .nan}"),
            "r.yaml: rules/a/min_score = nan, must be in [0, 1]");
  EXPECT_EQ(
      errorOfRule("{name: a, label: x, range: [0, 3], action: stop}, {name: a, label: x, range: [0, 3], action: stop}"),
      "r.yaml: rules/a is there twice, must be once");
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [0, 3], action: stop, zone: 3}")
                .find("r.yaml: rules/0/zone means nothing here; known are action, "),
            0U);
  EXPECT_EQ(errorOfRule("{name: a, label: x, range: [0, 3], action: stop, text: halt}"),
            "r.yaml: rules/a/text = \"halt\", must be left out for stop");
  EXPECT_EQ(errorOfRule("{label: x}"), "r.yaml: rules/0/name is missing");
}

TEST(ReactionRulesOptions, TheFileIsValid)
{
  EXPECT_EQ(ReactionRulesOptions::load(CONFIG_DIR "/reaction.yaml").rules.size(), 4U);
  EXPECT_THROW(ReactionRulesOptions::load("no/such/file.yaml"), std::invalid_argument);
}

}  // namespace
