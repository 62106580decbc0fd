#include "decision/reaction_rules.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_node/yaml_section.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace pi_vehicle
{

using pi_node::seconds;

namespace
{

/// In the order of ReactionAction.
constexpr const char* REACTION_ACTIONS[] = {"greet", "horn", "say", "slow", "stop"};

bool once(ReactionAction action)
{
  return action != ReactionAction::SLOW && action != ReactionAction::STOP;
}

ReactionRule readRule(pi_node::YamlSection& entry)
{
  ReactionRule rule;
  rule.name = entry.get<std::string>("name", "a text");
  rule.label = entry.get<std::string>("label", "a label or \"*\"");
  const bool polygon = entry.has("polygon");
  if (polygon == entry.has("range"))
  {
    throw std::invalid_argument(
        entry.name(polygon ? "polygon and range are both there" : "polygon or range is missing") +
        ", must be one of them");
  }
  if (polygon)
  {
    for (const auto& corner : entry.get<std::vector<std::vector<double>>>("polygon", "a list of [x, y]"))
    {
      if (corner.size() != 2)
      {
        entry.refuse("polygon", "a corner of " + std::to_string(corner.size()) + " numbers", "a list of [x, y]");
      }
      rule.polygon.emplace_back(corner[0], corner[1]);
    }
    if (rule.polygon.empty())
    {
      entry.refuse("polygon", "[]", "a list of 3 corners or more");
    }
  }
  else
  {
    const auto range = entry.get<std::vector<double>>("range", "[least, most] in metres");
    if (range.size() != 2)
    {
      entry.refuse("range", std::to_string(range.size()) + " numbers", "[least, most] in metres");
    }
    rule.min_range = range[0];
    rule.max_range = range[1];
    entry.read("bearing", "a number", &rule.max_bearing);
  }
  entry.read("min_score", "a number", &rule.min_score);
  entry.read("persistence", "a number", &rule.persistence);
  entry.read("gap", "a number", &rule.gap);
  entry.read("cooldown", "a number", &rule.cooldown);
  entry.read("hold", "a number", &rule.hold);
  const auto action = entry.get<std::string>("action", "an action");
  const auto* known = std::find(std::begin(REACTION_ACTIONS), std::end(REACTION_ACTIONS), action);
  if (known == std::end(REACTION_ACTIONS))
  {
    entry.refuse("action", "\"" + action + "\"", "one of greet, horn, say, slow, stop");
  }
  rule.action = static_cast<ReactionAction>(known - REACTION_ACTIONS);
  entry.read("text", "a text", &rule.text);
  entry.read("speed", "a number", &rule.speed);
  entry.finish();
  return rule;
}

ReactionRulesOptions readRules(pi_node::YamlSection top)
{
  ReactionRulesOptions options;
  for (pi_node::YamlSection& entry : top.list("rules"))
  {
    options.rules.push_back(readRule(entry));
  }
  return top.checked(options);
}

}  // namespace

ReactionRulesOptions ReactionRulesOptions::load(const std::string& path)
{
  return readRules(pi_node::YamlSection::load(path));
}

ReactionRulesOptions ReactionRulesOptions::parse(const std::string& yaml, const std::string& name)
{
  return readRules(pi_node::YamlSection::parse(yaml, name));
}

void ReactionRulesOptions::validate() const
{
  for (size_t i = 0; i < rules.size(); ++i)
  {
    const ReactionRule& rule = rules[i];
    if (rule.name.empty())
    {
      throw std::invalid_argument("rules/" + std::to_string(i) + "/name is empty, must be a text");
    }
    const std::string name = "rules/" + rule.name;
    const pi_node::OptionCheck check(name);
    if (std::any_of(rules.begin(), rules.begin() + static_cast<std::ptrdiff_t>(i),
                    [&rule](const ReactionRule& other) { return other.name == rule.name; }))
    {
      throw std::invalid_argument(name + " is there twice, must be once");
    }
    if (rule.label.empty())
    {
      throw std::invalid_argument(name + "/label is empty, must be a label or \"*\"");
    }
    if (rule.polygon.empty())
    {
      check.range("max_range", rule.max_range, 0.1, 100.0);
      check.range("min_range", rule.min_range, 0.0, rule.max_range);
      check.range("bearing", rule.max_bearing, 0.01, M_PI);
    }
    else if (rule.polygon.size() < 3)
    {
      throw std::invalid_argument(name + "/polygon has " + std::to_string(rule.polygon.size()) +
                                  " corners, must have at least 3");
    }
    for (const Eigen::Vector2d& corner : rule.polygon)
    {
      check.range("polygon", corner.x(), -100.0, 100.0);
      check.range("polygon", corner.y(), -100.0, 100.0);
    }
    check.range("min_score", rule.min_score, 0.0, 1.0);
    check.range("persistence", rule.persistence, 0.0, 60.0);
    check.range("gap", rule.gap, 0.0, 60.0);
    check.range("cooldown", rule.cooldown, 0.0, 86400.0);
    check.range("hold", rule.hold, 0.0, 600.0);
    if (rule.text.empty() ? rule.action == ReactionAction::SAY
                          : rule.action != ReactionAction::SAY && rule.action != ReactionAction::GREET)
    {
      throw std::invalid_argument(name + "/text = \"" + rule.text + "\", must be " +
                                  (rule.text.empty() ? "given for " : "left out for ") + toString(rule.action));
    }
    if (rule.action == ReactionAction::SLOW)
    {
      check.range("speed", rule.speed, 0.05, 10.0);
    }
  }
}

ReactionRules::ReactionRules(const ReactionRulesOptions& options) : options_(options), states_(options.rules.size())
{
  options_.validate();
}

bool ReactionRules::inZone(const ReactionRule& rule, const Eigen::Vector2d& position)
{
  if (rule.polygon.empty())
  {
    const double range = position.norm();
    return range >= rule.min_range && range <= rule.max_range &&
           std::abs(std::atan2(position.y(), position.x())) <= rule.max_bearing;
  }
  bool inside = false;  // counts the sides to the left of the point
  for (size_t i = 0, j = rule.polygon.size() - 1; i < rule.polygon.size(); j = i++)
  {
    const Eigen::Vector2d& a = rule.polygon[i];
    const Eigen::Vector2d& b = rule.polygon[j];
    if ((a.y() > position.y()) != (b.y() > position.y()) &&
        position.x() < (b.x() - a.x()) * (position.y() - a.y()) / (b.y() - a.y()) + a.x())
    {
      inside = !inside;
    }
  }
  return inside;
}

void ReactionRules::notice(size_t index, const std::vector<SeenThing>& things, int64_t now_ns)
{
  const ReactionRule& rule = options_.rules[index];
  for (const SeenThing& thing : things)
  {
    if ((rule.label != "*" && thing.label != rule.label) || !thing.position.allFinite() ||
        !(thing.score >= rule.min_score) || !inZone(rule, thing.position))
    {
      continue;
    }
    const auto [stay, fresh] = states_[index].stays.try_emplace(thing.id, Stay{now_ns, now_ns, thing});
    if (!fresh && seconds(now_ns - stay->second.last_ns) > rule.gap + 1e-9)
    {
      stay->second.since_ns = now_ns;
      greeted_.erase({index, thing.id});
    }
    stay->second.last_ns = now_ns;
    stay->second.thing = thing;
  }
}

void ReactionRules::forgetGone(size_t index, int64_t now_ns)
{
  auto& stays = states_[index].stays;
  for (auto stay = stays.begin(); stay != stays.end();)
  {
    const bool gone = seconds(now_ns - stay->second.last_ns) > options_.rules[index].gap + 1e-9;
    if (gone)
    {
      greeted_.erase({index, stay->first});
    }
    stay = gone ? stays.erase(stay) : std::next(stay);
  }
}

bool ReactionRules::react(size_t index, int64_t now_ns, std::vector<RuleEvent>* events)
{
  const ReactionRule& rule = options_.rules[index];
  RuleState& state = states_[index];
  bool present = false;
  bool can_act = !state.acted || seconds(now_ns - state.acted_ns) >= rule.cooldown - 1e-9;
  for (const auto& [id, times] : state.stays)
  {
    // The time it was seen counts, not the gap after it.
    if (seconds(times.last_ns - times.since_ns) < rule.persistence - 1e-9)
    {
      continue;
    }
    const bool begins = once(rule.action) ? can_act && !greeted_[{index, id}] : !state.active && !present;
    present = true;
    if (begins)
    {
      events->push_back({rule.name, rule.action, rule.text, times.thing});
      state.acted = true;
      state.acted_ns = now_ns;
      greeted_[{index, id}] = true;
      can_act = rule.cooldown <= 0.0;
    }
  }
  return present;
}

ReactionResult ReactionRules::update(int64_t now_ns, const std::vector<SeenThing>& things)
{
  if (have_now_ && now_ns < last_ns_)
  {
    states_.assign(states_.size(), RuleState());
    greeted_.clear();
  }
  have_now_ = true;
  last_ns_ = now_ns;

  ReactionResult result;
  result.speed_limit = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < states_.size(); ++i)
  {
    const ReactionRule& rule = options_.rules[i];
    RuleState& state = states_[i];
    notice(i, things, now_ns);
    forgetGone(i, now_ns);
    const bool present = react(i, now_ns, &result.events);
    if (once(rule.action))
    {
      continue;
    }
    if (present)
    {
      state.held_ns = now_ns;
    }
    state.active = present || (state.active && seconds(now_ns - state.held_ns) <= rule.hold + 1e-9);
    const double limit = rule.action == ReactionAction::STOP ? 0.0 : rule.speed;
    if (state.active && limit < result.speed_limit)
    {
      result.speed_limit = limit;
      result.reason = rule.name;
    }
  }
  return result;
}

const char* toString(ReactionAction action)
{
  return REACTION_ACTIONS[static_cast<size_t>(action)];
}

}  // namespace pi_vehicle
