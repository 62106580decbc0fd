#include <pi_node/option_check.h>
#include <pi_node/yaml_section.h>

#include <cmath>
#include <filesystem>
#include <set>
#include <sstream>
#include <stdexcept>
#include <type_traits>

#include "simulation/loop_route.h"
#include "simulation/simulation.h"

namespace pi_offload
{
namespace
{

using pi_node::YamlSection;

constexpr double MOST_METRES = 1e7;

[[noreturn]] void refuse(const std::string& key, const std::string& value, const std::string& bound)
{
  throw std::invalid_argument(key + " = " + value + ", must be " + bound);
}

// Each function below calls visit(name, field, least, most) for the numbers of a part and visit(name, field) for fields
// that are checked elsewhere. Reading and validating use the same list.

template <typename Part, typename Visit>
void visitWorld(Part& scenario, const Visit& visit)
{
  visit("duration_s", scenario.duration_s, 1e-3, 1e6);
  visit("vehicles", scenario.vehicles, 1, 10000);
  visit("speed", scenario.speed, 0.0, 100.0);
}

template <typename Part, typename Visit>
void visitStream(Part& stream, const Visit& visit)
{
  visit("rate_hz", stream.rate_hz, 1e-3, 1000.0);
  visit("regular", stream.regular);
  visit("deadline_s", stream.deadline_s, 1e-3, 60.0);
  visit("work_gcycles", stream.work_gcycles, 0.0, 1e6);
  visit("local_s", stream.local_s, 1e-6, 60.0);
  visit("local_deviation", stream.local_deviation, 0.0, 3.0);
  visit("local_j", stream.local_j, 1e-9, 1e6);
  visit("input_bytes", stream.input_bytes, 0U, 1U << 25U);
  visit("output_bytes", stream.output_bytes, 0U, 1U << 25U);
}

template <typename Part, typename Visit>
void visitNode(Part& node, const Visit& visit)
{
  visit("workers", node.workers, 1, 1024);
  visit("service_deviation", node.service_deviation, 0.0, 3.0);
  visit("slow_share", node.slow_share, 0.0, 1.0);
  visit("slow_factor", node.slow_factor, 1.0, 1000.0);
}

template <typename Part, typename Visit>
void visitNetwork(Part& network, const Visit& visit)
{
  visit("rate_near_mbps", network.rate_near_mbps, 1e-3, 1e6);
  visit("rate_edge_mbps", network.rate_edge_mbps, 1e-3, 1e6);
  visit("shadowing_db", network.shadowing_db, 0.0, 30.0);
  visit("correlation_m", network.correlation_m, 0.1, 1e6);
  visit("round_trip_s", network.round_trip_s, 0.0, 60.0);
  visit("round_trip_deviation", network.round_trip_deviation, 0.0, 3.0);
  visit("loss", network.loss, 0.0, 1.0);
  visit("retransmission_s", network.retransmission_s, 0.0, 60.0);
}

template <typename Part, typename Visit>
void visitLoad(Part& load, const Visit& visit)
{
  visit("base_load", load.base_load, 0.0, 100.0);
  visit("heavy_share", load.heavy_share, 0.0, 1.0);
  visit("heavy_load", load.heavy_load, 0.0, 100.0);
  visit("mean_burst_s", load.mean_burst_s, 1e-3, 1e6);
  visit("task_s", load.task_s, 1e-6, 60.0);
  visit("time_left", load.time_left, 1e-3, 1.0);
  visit("vehicles", load.vehicles, 1, 10000);
  visit("leases", load.leases);
}

template <typename Part, typename Visit>
void visitFailures(Part& failures, const Visit& visit)
{
  visit("mean_between_s", failures.mean_between_s, 0.0, 1e9);
  visit("mean_repair_s", failures.mean_repair_s, 1e-3, 1e9);
}

/// Visitor that reads fields from a section.
class Reader
{
public:
  explicit Reader(YamlSection* section) : section_(section) {}

  template <typename Value, typename... Bounds>
  void operator()(const char* name, Value& value, Bounds...) const
  {
    const char* kind = std::is_same_v<Value, bool>       ? "true or false"
                       : std::is_floating_point_v<Value> ? "a number"
                       : std::is_unsigned_v<Value>       ? "a whole number, at least 0"
                       : std::is_integral_v<Value>       ? "a whole number"
                                                         : "a text";
    section_->read(name, kind, &value);
  }

private:
  YamlSection* section_;
};

/// Visitor that checks the bounds of fields.
class Checker
{
public:
  explicit Checker(const std::string& group) : check_(group) {}

  template <typename Value>
  void operator()(const char*, const Value&) const
  {
  }
  template <typename Value, typename Bound>
  void operator()(const char* name, const Value& value, Bound least, Bound most) const
  {
    check_.range<Value>(name, value, least, most);
  }

private:
  pi_node::OptionCheck check_;
};

/// Calls read(section, reader) if there is a map `name`, then refuses unknown fields.
template <typename Read>
void readPart(YamlSection* parent, const char* name, const Read& read)
{
  if (parent->has(name))
  {
    YamlSection section = parent->section(name);
    read(&section, Reader(&section));
    section.finish();
  }
}

/// A map from kinds of task.
template <typename Value>
void readByKind(YamlSection* parent, const char* name, std::array<Value, TASK_KINDS>* values)
{
  readPart(parent, name,
           [values](YamlSection*, const Reader& read)
           {
             for (size_t kind = 0; kind < TASK_KINDS; ++kind)
             {
               read(toString(static_cast<TaskKind>(kind)), (*values)[kind]);
             }
           });
}

Point readPoint(const YAML::Node& node, const std::string& name)
{
  Point point;
  if (!node.IsSequence() || node.size() != 2 || !YAML::convert<double>::decode(node[0], point.x) ||
      !YAML::convert<double>::decode(node[1], point.y))
  {
    throw std::invalid_argument(name + " must be a point [x, y]");
  }
  return point;
}

std::vector<Point> readRoute(YamlSection* section)
{
  const YAML::Node points = section->node("route");
  if (!points.IsSequence())
  {
    throw std::invalid_argument(section->name("route") + " must be a list of points [x, y]");
  }
  std::vector<Point> route;
  for (size_t i = 0; i < points.size(); ++i)
  {
    route.push_back(readPoint(points[i], section->name("route") + "/" + std::to_string(i)));
  }
  return route;
}

void readEngine(YamlSection* section, EngineOptions* engine)
{
  const Reader read(section);
  read("eta", engine->eta);
  read("advertisement_valid_s", engine->advertisement_valid_s);
  read("probe_period_s", engine->probe_period_s);
  read("probe_period_far_s", engine->probe_period_far_s);
  read("max_failures", engine->max_failures);
  read("max_in_flight", engine->max_in_flight);
  readPart(section, "computer",
           [computer = &engine->computer](YamlSection*, const Reader& of)
           {
             of("frequency_ghz", computer->frequency_ghz);
             of("least_frequency_ghz", computer->least_frequency_ghz);
             of("static_w", computer->static_w);
             of("beta_w_per_ghz3", computer->beta_w_per_ghz3);
           });
  readPart(section, "radio",
           [radio = &engine->radio](YamlSection*, const Reader& of)
           {
             of("transmit_w", radio->transmit_w);
             of("receive_w", radio->receive_w);
             of("wait_w", radio->wait_w);
             of("tail_w", radio->tail_w);
             of("tail_s", radio->tail_s);
           });
  readPart(section, "policy",
           [policy = &engine->policy](YamlSection*, const Reader& of)
           {
             of("miss_cost_j", policy->miss_cost_j);
             of("deviations", policy->deviations);
             of("residence_share", policy->residence_share);
             of("hysteresis", policy->hysteresis);
             of("fallback_factor", policy->fallback_factor);
             of("needed_capacity_gcycles", policy->needed_capacity_gcycles);
             of("scale_frequency", policy->scale_frequency);
             of("fallback_miss_share", policy->fallback_miss_share);
             of("curiosity_s", policy->curiosity_s);
             of("hedge_share", policy->hedge_share);
             of("lost_j", policy->lost_j);
           });
}

void readAdmission(YamlSection* section, AdmissionOptions* admission)
{
  const Reader read(section);
  read("max_queued", admission->max_queued);
  read("max_queued_per_vehicle", admission->max_queued_per_vehicle);
  read("lease_s", admission->lease_s);
  read("lease_turn_s", admission->lease_turn_s);
  read("max_leased_load", admission->max_leased_load);
  read("fair_window_s", admission->fair_window_s);
  read("max_vehicles", admission->max_vehicles);
  readByKind(section, "first_service_s", &admission->first_service_s);
  readByKind(section, "served", &admission->served);
}

Scenario::Stream readStream(YamlSection* section)
{
  Scenario::Stream stream;
  stream.kind = parseTaskKind(section->get<std::string>("kind", "a text"));
  visitStream(stream, Reader(section));
  return stream;
}

Scenario::Node readNode(YamlSection* section)
{
  Scenario::Node node;
  NodeDescription& description = node.description;
  description.id = section->get<std::string>("id", "a text");
  description.address = description.id + ":1";
  description.position = readPoint(section->node("position"), section->name("position"));
  description.range_m = section->get<double>("range_m", "a number");
  const Reader read(section);
  read("frequency_ghz", description.frequency_ghz);
  visitNode(node, read);
  readByKind(section, "service_s", &node.service_s);
  return node;
}

Scenario readScenario(YamlSection section)
{
  Scenario scenario;
  const Reader read(&section);
  read("name", scenario.name);
  visitWorld(scenario, read);
  scenario.route = readRoute(&section);
  readPart(&section, "engine", [&](YamlSection* engine, const Reader&) { readEngine(engine, &scenario.engine); });
  readPart(&section, "admission",
           [&](YamlSection* admission, const Reader&) { readAdmission(admission, &scenario.admission); });
  for (YamlSection& stream : section.list("streams"))
  {
    scenario.streams.push_back(readStream(&stream));
    stream.finish();
  }
  for (YamlSection& node : section.list("nodes"))
  {
    scenario.nodes.push_back(readNode(&node));
    node.finish();
  }
  readPart(&section, "network", [&](YamlSection*, const Reader& of) { visitNetwork(scenario.network, of); });
  readPart(&section, "load", [&](YamlSection*, const Reader& of) { visitLoad(scenario.load, of); });
  readPart(&section, "failures", [&](YamlSection*, const Reader& of) { visitFailures(scenario.failures, of); });
  section.finish();
  for (const Scenario::Stream& stream : scenario.streams)
  {
    scenario.engine.needs[static_cast<size_t>(stream.kind)] = {
        stream.work_gcycles, 8e-6 * static_cast<double>(stream.input_bytes),
        8e-6 * static_cast<double>(stream.output_bytes), stream.deadline_s};
  }
  return scenario;
}

void validateStreams(const Scenario& scenario)
{
  std::set<TaskKind> kinds;
  for (const Scenario::Stream& stream : scenario.streams)
  {
    const std::string group = std::string("streams/") + toString(stream.kind);
    visitStream(stream, Checker(group));
    if (!kinds.insert(stream.kind).second)
    {
      refuse(group, "given twice", "given once");
    }
  }
  if (scenario.streams.empty())
  {
    refuse("streams", "[]", "at least one");
  }
}

void validateNodes(const Scenario& scenario)
{
  std::set<std::string> ids;
  for (const Scenario::Node& node : scenario.nodes)
  {
    node.description.validate();
    const std::string group = "nodes/" + node.description.id;
    const Checker check(group);
    visitNode(node, check);
    for (const double service_s : node.service_s)
    {
      check("service_s", service_s, 1e-6, 60.0);
    }
    if (!ids.insert(node.description.id).second)
    {
      refuse(group, "given twice", "given once");
    }
    const auto [least, most] = std::minmax(node.service_s[0], node.service_s[1]);
    if (scenario.load.task_s < least || scenario.load.task_s > most)
    {
      std::ostringstream bound;
      bound << "within service_s of both kinds of " << group << ", [" << least << ", " << most << "]";
      refuse("load/task_s", std::to_string(scenario.load.task_s), bound.str());
    }
  }
}

}  // namespace

const Scenario::Stream* Scenario::stream(TaskKind kind) const
{
  for (const Stream& stream : streams)
  {
    if (stream.kind == kind)
    {
      return &stream;
    }
  }
  return nullptr;
}

void Scenario::validate() const
{
  const Checker check("");
  visitWorld(*this, check);
  for (const Point& point : route)
  {
    check("route", point.x, -MOST_METRES, MOST_METRES);
    check("route", point.y, -MOST_METRES, MOST_METRES);
  }
  const simulation::LoopRoute loop(route);  // throws if it has no length
  visitNetwork(network, Checker("network"));
  visitLoad(load, Checker("load"));
  visitFailures(failures, Checker("failures"));
  validateStreams(*this);
  validateNodes(*this);
  admission.validate();
  engine.validate();
}

Scenario Scenario::load_file(const std::string& path)
{
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error))
  {
    throw std::runtime_error(path +
                             ": there is no such file: a scenario is a YAML file, see "
                             "pi_offload/config/scenarios");
  }
  Scenario scenario;
  try
  {
    scenario = readScenario(YamlSection::load(path));
  }
  catch (const YAML::Exception& failure)
  {
    throw std::runtime_error(path + ": no YAML: " + failure.what());
  }
  catch (const std::invalid_argument& failure)
  {
    const std::string text = failure.what();
    throw std::runtime_error(text.rfind(path, 0) == 0 ? text : path + ": " + text);
  }
  if (scenario.name.empty())
  {
    scenario.name = std::filesystem::path(path).stem().string();
  }
  try
  {
    scenario.validate();
  }
  catch (const std::invalid_argument& failure)
  {
    throw std::runtime_error(path + ": " + failure.what());
  }
  return scenario;
}

}  // namespace pi_offload
