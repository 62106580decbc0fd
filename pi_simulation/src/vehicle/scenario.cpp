#include "vehicle/scenario.h"

#include "vehicle/rounded_json.h"
#include "world/path_shape.h"

#include <pi_node/formatting.h>
#include <pi_node/yaml_section.h>
#include <pi_speech/noise_mixing.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <random>
#include <set>
#include <sstream>
#include <stdexcept>

namespace pi_simulation
{
namespace
{

constexpr double FAR_M = 1000.0;
constexpr double LONG_S = 86400.0;

/// The same numbers with every standard library.
class Random
{
public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  double within(double reach) { return reach * (2.0 * static_cast<double>(engine_() >> 11) * 0x1p-53 - 1.0); }

private:
  std::mt19937_64 engine_;
};

double number(pi_node::YamlSection* section, const std::string& field, double least, double most)
{
  double value = section->get<double>(field, "a number");
  section->readNumber(field, least, most, &value);
  return value;
}

std::string text(pi_node::YamlSection* section, const std::string& field)
{
  const auto value = section->get<std::string>(field, "a text");
  if (value.empty())
  {
    section->refuse(field, "\"\"", "a text");
  }
  return value;
}

/// Numbers of a list.
std::vector<double> numbers(const pi_node::YamlSection& section, const std::string& field, const YAML::Node& node,
                            size_t count, const char* kind)
{
  std::vector<double> values;
  try
  {
    values = node.as<std::vector<double>>();
  }
  catch (const YAML::Exception&)
  {
    section.refuse(field, "(no list of numbers)", kind);
  }
  const bool good = values.size() == count &&
                    std::all_of(values.begin(), values.end(), [](double value) { return std::abs(value) <= FAR_M; });
  if (!good)
  {
    section.refuse(field, "(a list of " + std::to_string(values.size()) + " numbers)", kind);
  }
  return values;
}

Eigen::Vector2d point(pi_node::YamlSection* section, const std::string& field)
{
  const std::vector<double> p = numbers(*section, field, section->node(field), 2, "[x, y] within 1000 m");
  return {p[0], p[1]};
}

std::vector<Eigen::Vector2d> points(pi_node::YamlSection* section, const std::string& field)
{
  const YAML::Node list = section->node(field);
  if (!list.IsSequence() || list.size() == 0)
  {
    section->refuse(field, "(no list)", "a list of points [x, y]");
  }
  std::vector<Eigen::Vector2d> result;
  for (size_t i = 0; i < list.size(); ++i)
  {
    const std::vector<double> p = numbers(*section, field, list[i], 2, "a list of points [x, y] within 1000 m");
    result.emplace_back(p[0], p[1]);
  }
  return result;
}

pi_vehicle::Pose2 pose(pi_node::YamlSection* section, const std::string& field)
{
  const std::vector<double> p = numbers(*section, field, section->node(field), 3, "[x, y, heading]");
  return {p[0], p[1], p[2]};
}

std::vector<pi_vehicle::Pose2> poses(pi_node::YamlSection* section, const std::string& field)
{
  const YAML::Node list = section->node(field);
  if (!list.IsSequence() || list.size() == 0)
  {
    section->refuse(field, "(no list)", "a list of poses [x, y, heading]");
  }
  std::vector<pi_vehicle::Pose2> result;
  for (size_t i = 0; i < list.size(); ++i)
  {
    const std::vector<double> p = numbers(*section, field, list[i], 3, "a list of poses [x, y, heading]");
    result.push_back({p[0], p[1], p[2]});
  }
  return result;
}

/// `near: [x, y]` and `within`, both or none.
void readPlace(pi_node::YamlSection* section, std::optional<Eigen::Vector2d>* near, double* within)
{
  if (section->has("near"))
  {
    *near = point(section, "near");
    *within = number(section, "within", 0.1, FAR_M);
  }
  else if (section->has("within"))
  {
    section->refuse("within", "(without near)", "given together with near: [x, y]");
  }
}

std::vector<Eigen::Vector2d> readRoad(pi_node::YamlSection* section)
{
  const YAML::Node road = section->node("road");
  if (road.IsSequence())
  {
    const std::vector<Eigen::Vector2d> corners = points(section, "road");
    if (corners.size() < 2)
    {
      section->refuse("road", "(one point)", "two points or more, or campus_loop");
    }
    std::vector<Eigen::Vector2d> line;
    for (size_t i = 1; i < corners.size(); ++i)
    {
      const Eigen::Vector2d way = corners[i] - corners[i - 1];
      const int steps = std::max(1, static_cast<int>(std::ceil(way.norm())));
      for (int k = 0; k < steps; ++k)
      {
        line.push_back(corners[i - 1] + way * (static_cast<double>(k) / steps));
      }
    }
    line.push_back(corners.back());
    return line;
  }
  if (section->get<std::string>("road", "campus_loop or points") != "campus_loop")
  {
    section->refuse("road", road.Scalar(), "campus_loop, or a list of points [x, y]");
  }
  std::vector<Eigen::Vector2d> line = pathLine(PathShape::CAMPUS_LOOP, 0.0);
  line.push_back(line.front());
  return line;
}

void readTrigger(pi_node::YamlSection* section, ActorTrigger* result)
{
  pi_node::YamlSection trigger = section->section("trigger");
  if (trigger.has("time"))
  {
    result->time = number(&trigger, "time", 0.0, LONG_S);
  }
  readPlace(&trigger, &result->near, &result->within);
  trigger.read("command", "true or false", &result->command);
  trigger.finish();
  if (result->command && (result->time || result->near))
  {
    section->refuse("trigger", "(command with time or near)", "command alone, or time, near with within, or both");
  }
}

std::vector<ActorPause> readPauses(pi_node::YamlSection* section)
{
  std::vector<ActorPause> pauses;
  for (pi_node::YamlSection& entry : section->list("pauses"))
  {
    pauses.push_back({number(&entry, "at", 0.0, FAR_M), number(&entry, "for", 0.0, LONG_S)});
    entry.finish();
  }
  std::sort(pauses.begin(), pauses.end(), [](const ActorPause& a, const ActorPause& b) { return a.at < b.at; });
  return pauses;
}

/// Random changes within the ranges of `vary`.
void vary(pi_node::YamlSection section, Random* random, ActorPlan* actor)
{
  double x = 0.0;
  double y = 0.0;
  double speed = 0.0;
  double time = 0.0;
  section.readNumber("x", 0.0, 50.0, &x);
  section.readNumber("y", 0.0, 50.0, &y);
  section.readNumber("speed", 0.0, 0.9, &speed);
  section.readNumber("pause", 0.0, 0.9, &time);
  section.finish();
  const double shift_y = random->within(y);  // before x: two draws in one list of arguments have no order
  const Eigen::Vector2d shift(random->within(x), shift_y);
  for (Eigen::Vector2d& corner : actor->path)
  {
    corner += shift;
  }
  if (actor->trigger.near)
  {
    *actor->trigger.near += shift;
  }
  actor->speed *= 1.0 + random->within(speed);
  for (ActorPause& pause : actor->pauses)
  {
    pause.duration *= 1.0 + random->within(time);
  }
}

ActorPlan readActor(pi_node::YamlSection* section, Random* random)
{
  ActorPlan actor;
  actor.id = text(section, "id");
  actor.class_name = text(section, "class");
  if (!isActorClass(actor.class_name))
  {
    section->refuse("class", actor.class_name, actorClasses());
  }
  actor.path = points(section, "path");
  section->readNumber("heading", -7.0, 7.0, &actor.heading);
  section->readNumber("speed", 0.05, 15.0, &actor.speed);
  section->readNumber("acceleration", 0.1, 20.0, &actor.acceleration);
  if (section->has("size"))
  {
    const std::vector<double> size = numbers(*section, "size", section->node("size"), 3, "[length, width, height]");
    actor.size = {size[0], size[1], size[2]};
    const bool sized = actor.class_name == "box" || actor.class_name == "kerb";
    if (!sized || (actor.size.array() < 0.05).any() || (actor.size.array() > 10.0).any())
    {
      section->refuse("size", "(three numbers)", "for a box or a kerb only, each in [0.05, 10]");
    }
  }
  if (section->has("height"))
  {
    actor.size.z() = number(section, "height", 0.8, 2.1);
    if (actor.class_name != "person")
    {
      section->refuse("height", pi_node::format("%.2f", actor.size.z()), "for a person only");
    }
  }
  if (section->has("trigger"))
  {
    readTrigger(section, &actor.trigger);
  }
  if (section->has("pauses"))
  {
    actor.pauses = readPauses(section);
  }
  section->read("hidden", "true or false", &actor.hidden);
  if (section->has("vanish_after"))
  {
    actor.vanish_after = number(section, "vanish_after", 0.0, LONG_S);
  }
  section->read("vanish_at_end", "true or false", &actor.vanish_at_end);
  if (section->has("vary"))
  {
    vary(section->section("vary"), random, &actor);
  }
  section->finish();
  return actor;
}

SpokenWords readSpoken(pi_node::YamlSection* section)
{
  SpokenWords words;
  words.clip = text(section, "clip");
  section->read("text", "a text", &words.text);
  if (section->has("time"))
  {
    words.time = number(section, "time", 0.0, LONG_S);
  }
  readPlace(section, &words.near, &words.within);
  if (words.time.has_value() == words.near.has_value())
  {
    section->refuse("time", words.time ? "(and near)" : "(missing, as near is)", "given, or near, but not both");
  }
  section->readNumber("delay", 0.0, LONG_S, &words.delay);
  section->finish();
  return words;
}

EdgeNode readEdgeNode(pi_node::YamlSection* section)
{
  EdgeNode node;
  node.id = text(section, "id");
  node.position = {number(section, "x", -FAR_M, FAR_M), number(section, "y", -FAR_M, FAR_M)};
  node.range = number(section, "range", 0.1, FAR_M);
  section->finish();
  return node;
}

/// A command line, of which only the first word is checked here.
std::string command(pi_node::YamlSection* section, const std::string& field)
{
  static const std::set<std::string> KNOWN = {"actor",   "battery", "button", "camera", "garbage",
                                              "imu",     "kill",    "plug",   "pose",   "radio",
                                              "restart", "silent",  "slip",   "stuck",  "unplug"};
  const std::string line = text(section, field);
  const std::string word = line.substr(0, line.find(' '));
  const bool for_runner = word == "kill" || word == "radio";
  if (KNOWN.count(word) == 0 || (for_runner && !isForRunner(line)))
  {
    section->refuse(field, "\"" + line + "\"",
                    "a command of the simulator (see docs/design/vehicle_simulator.md), kill NODE, or radio on|off");
  }
  return line;
}

PlannedFault readFault(pi_node::YamlSection* section)
{
  PlannedFault fault;
  readPlace(section, &fault.near, &fault.within);
  if (!fault.near || section->has("time"))
  {
    fault.time = number(section, "time", 0.0, LONG_S);
  }
  fault.begin = command(section, "command");
  section->readNumber("for", 0.0, LONG_S, &fault.duration);
  if (section->has("end"))
  {
    fault.end = command(section, "end");
  }
  if (fault.duration > 0.0 ? fault.end.empty() : !fault.end.empty() && !fault.near)
  {
    section->refuse("end", "\"" + fault.end + "\"", "given together with for, the seconds until it, or with near");
  }
  section->finish();
  return fault;
}

void readExpectation(pi_node::YamlSection* section, Scenario* scenario)
{
  section->read("expect", "a text", &scenario->expect);
  if (scenario->expect != "reach" && scenario->expect != "refuse" && scenario->expect != "stop")
  {
    section->refuse("expect", scenario->expect, "reach, refuse or stop");
  }
  if (scenario->expect == "refuse")
  {
    if (!section->has("reason"))
    {
      section->refuse("reason", "(missing)", "part of what the vehicle says why, as expect = refuse asks for");
    }
    scenario->reason = text(section, "reason");
  }
}

/// The sound around the vehicle: the runner of a drive reads it, and gives it to the microphone.
void checkBackground(pi_node::YamlSection section)
{
  const std::string sound = text(&section, "sound");
  if (!pi_speech::NoiseSource::isMade(sound) && sound.front() != '/')
  {
    section.refuse("sound", sound, "white, pink, wind, or the absolute path of a sound file");
  }
  double level_dbfs = 0.0;
  section.readNumber("level_dbfs", -90.0, 0.0, &level_dbfs);
  section.finish();
}

template <typename Item>
std::vector<Item> readList(pi_node::YamlSection* section, const std::string& field,
                           const std::function<Item(pi_node::YamlSection*)>& read)
{
  std::vector<Item> items;
  if (section->has(field))
  {
    for (pi_node::YamlSection& entry : section->list(field))
    {
      items.push_back(read(&entry));
    }
  }
  return items;
}

Scenario readScenario(pi_node::YamlSection* section, uint64_t seed)
{
  Random random(seed);
  Scenario scenario;
  scenario.name = text(section, "name");
  double world_seed = 1.0;
  section->readNumber("world_seed", 0.0, 1e9, &world_seed);
  scenario.world_seed = static_cast<uint64_t>(world_seed);
  scenario.road = readRoad(section);
  section->read("parked", "true or false", &scenario.parked);
  section->readNumber("bumps", 0.0, 10.0, &scenario.bumps);
  section->readNumber("duration", 1.0, LONG_S, &scenario.duration);
  scenario.start = pose(section, "start");
  scenario.goal = pose(section, "goal");
  if (section->has("further_goals"))
  {
    scenario.further_goals = poses(section, "further_goals");
  }
  readExpectation(section, &scenario);
  section->readNumber("light", 0.01, 1.0, &scenario.light);
  section->readNumber("picture_noise", 0.0, 50.0, &scenario.picture_noise);
  if (section->has("background"))
  {
    checkBackground(section->section("background"));
  }
  if (section->has("waypoints"))
  {
    scenario.waypoints = points(section, "waypoints");
  }
  scenario.actors = readList<ActorPlan>(section, "actors",
                                        [&random](pi_node::YamlSection* entry) { return readActor(entry, &random); });
  std::set<std::string> ids;
  for (const ActorPlan& actor : scenario.actors)
  {
    if (!ids.insert(actor.id).second)
    {
      section->refuse("actors", "(two of id " + actor.id + ")", "of different ids");
    }
  }
  scenario.spoken = readList<SpokenWords>(section, "spoken", readSpoken);
  scenario.edge_nodes = readList<EdgeNode>(section, "edge_nodes", readEdgeNode);
  scenario.faults = readList<PlannedFault>(section, "faults", readFault);
  section->finish();
  return scenario;
}

}  // namespace

bool isForRunner(const std::string& command)
{
  const bool kills = command.rfind("kill ", 0) == 0 && command.find_first_of(" \t", 5) == std::string::npos;
  return (kills && command.size() > 5) || command == "radio on" || command == "radio off";
}

StereoRendererOptions Scenario::pictures(StereoRendererOptions options) const
{
  options.brightness *= light;
  options.shot_noise *= picture_noise * picture_noise;  // a variance
  options.read_noise *= picture_noise;
  return options;
}

Scenario Scenario::parse(const std::string& yaml, const std::string& name, uint64_t seed)
{
  pi_node::YamlSection section = pi_node::YamlSection::parse(yaml, name);
  return readScenario(&section, seed);
}

Scenario Scenario::load(const std::string& path, uint64_t seed)
{
  pi_node::YamlSection section = pi_node::YamlSection::load(path);
  return readScenario(&section, seed);
}

std::string Scenario::toJson(const pi_vehicle::Pose2& T_map_world) const
{
  const auto inMap = [&](const auto& place) { return pi_simulation::toJson(T_map_world * place); };
  Json json = {{"name", name},
               {"duration", rounded(duration)},
               {"map_in_world", pi_simulation::toJson(T_map_world.inverse())},
               {"start", inMap(start)},
               {"goal", inMap(goal)},
               {"further_goals", Json::array()},
               {"expect", expect},
               {"reason", reason},
               {"waypoints", Json::array()},
               {"actors", Json::array()},
               {"spoken", Json::array()},
               {"edge_nodes", Json::array()}};
  for (const pi_vehicle::Pose2& further : further_goals)
  {
    json["further_goals"].push_back(inMap(further));
  }
  for (const Eigen::Vector2d& waypoint : waypoints)
  {
    json["waypoints"].push_back(inMap(waypoint));
  }
  for (const ActorPlan& actor : actors)
  {
    json["actors"].push_back({{"id", actor.id}, {"class", actor.class_name}});
  }
  for (const SpokenWords& words : spoken)
  {
    Json one = {{"clip", words.clip}, {"text", words.text}};
    if (words.time)
    {
      one["time"] = rounded(*words.time);
    }
    if (words.near)
    {
      one["near"] = inMap(*words.near);
      one["within"] = rounded(words.within);
    }
    one["delay"] = rounded(words.delay);
    json["spoken"].push_back(one);
  }
  for (const EdgeNode& node : edge_nodes)
  {
    json["edge_nodes"].push_back({{"id", node.id}, {"position", inMap(node.position)}, {"range", rounded(node.range)}});
  }
  return toLine(json);
}

}  // namespace pi_simulation
