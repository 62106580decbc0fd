#include "simulation/simulation.h"

#include <pi_node/option_check.h>

#include <yaml-cpp/yaml.h>

#include <cmath>
#include <filesystem>
#include <set>
#include <sstream>
#include <stdexcept>

#include "simulation/loop_route.h"

namespace pi_offload
{
namespace
{

constexpr double MOST_METRES = 1e7;

[[noreturn]] void refuse(const std::string& key, const std::string& value, const std::string& bound)
{
  throw std::invalid_argument(key + " = " + value + ", must be " + bound);
}

/// A YAML map whose keys are asked for one by one; at the end, what nobody asked for is refused.
class Section
{
public:
  Section(YAML::Node node, std::string path) : node_(std::move(node)), path_(std::move(path))
  {
    if (!node_.IsMap())
    {
      throw std::invalid_argument((path_.empty() ? std::string("the file") : path_) + " must be a map of keys");
    }
  }

  std::string name(const std::string& key) const { return path_.empty() ? key : path_ + "/" + key; }

  bool has(const std::string& key)
  {
    known_.insert(key);
    return node_[key].IsDefined() && !node_[key].IsNull();
  }

  YAML::Node node(const std::string& key)
  {
    if (!has(key))
    {
      throw std::invalid_argument(name(key) + " is missing");
    }
    return node_[key];
  }

  template <typename Value>
  void read(const std::string& key, Value* value)
  {
    if (has(key))
    {
      *value = convert<Value>(node_[key], name(key));
    }
  }

  /// A map by kind of task.
  template <typename Value>
  void readByKind(const std::string& key, std::array<Value, TASK_KINDS>* values)
  {
    if (has(key))
    {
      Section section(node_[key], name(key));
      for (size_t kind = 0; kind < TASK_KINDS; ++kind)
      {
        section.read(toString(static_cast<TaskKind>(kind)), &(*values)[kind]);
      }
      section.finish();
    }
  }

  /// Calls read(Section) if the section is there.
  template <typename Read>
  void section(const std::string& key, const Read& read)
  {
    if (has(key))
    {
      Section section(node_[key], name(key));
      read(section);
      section.finish();
    }
  }

  /// Calls read(Section) for each entry of a list that must be there.
  template <typename Read>
  void list(const std::string& key, const Read& read)
  {
    const YAML::Node entries = node(key);
    if (!entries.IsSequence())
    {
      throw std::invalid_argument(name(key) + " must be a list");
    }
    for (size_t i = 0; i < entries.size(); ++i)
    {
      Section section(entries[i], name(key) + "[" + std::to_string(i) + "]");
      read(section);
      section.finish();
    }
  }

  /// @throws std::invalid_argument for a key that nobody knows: likely a slip.
  void finish() const
  {
    for (const auto& entry : node_)
    {
      const auto key = entry.first.as<std::string>();
      if (known_.count(key) == 0)
      {
        std::string list;
        for (const std::string& known : known_)
        {
          list += (list.empty() ? "" : ", ") + known;
        }
        throw std::invalid_argument(name(key) + " means nothing here; known are " + list);
      }
    }
  }

  template <typename Value>
  static Value convert(const YAML::Node& node, const std::string& name)
  {
    if constexpr (std::is_unsigned_v<Value> && !std::is_same_v<Value, bool>)
    {
      const auto number = convert<long long>(node, name);
      if (number < 0)
      {
        refuse(name, std::to_string(number), "at least 0");
      }
      return static_cast<Value>(number);
    }
    else
    {
      Value value;
      if (!node.IsScalar() || !YAML::convert<Value>::decode(node, value))
      {
        const char* kind = std::is_same_v<Value, bool>       ? "true or false"
                           : std::is_floating_point_v<Value> ? "a number"
                           : std::is_integral_v<Value>       ? "a whole number"
                                                             : "a text";
        refuse(name, node.IsScalar() ? "\"" + node.Scalar() + "\"" : "(not a single value)", kind);
      }
      return value;
    }
  }

private:
  YAML::Node node_;
  const std::string path_;
  std::set<std::string> known_;
};

Point readPoint(const YAML::Node& node, const std::string& name)
{
  if (!node.IsSequence() || node.size() != 2)
  {
    throw std::invalid_argument(name + " must be a point [x, y]");
  }
  return {Section::convert<double>(node[0], name), Section::convert<double>(node[1], name)};
}

void readEngine(Section& section, EngineOptions* engine)
{
  section.read("eta", &engine->eta);
  section.read("advertisement_valid_s", &engine->advertisement_valid_s);
  section.read("probe_period_s", &engine->probe_period_s);
  section.read("probe_period_far_s", &engine->probe_period_far_s);
  section.read("max_failures", &engine->max_failures);
  section.read("max_in_flight", &engine->max_in_flight);
  section.section("computer",
                  [&](Section& computer)
                  {
                    computer.read("frequency_ghz", &engine->computer.frequency_ghz);
                    computer.read("least_frequency_ghz", &engine->computer.least_frequency_ghz);
                    computer.read("static_w", &engine->computer.static_w);
                    computer.read("beta_w_per_ghz3", &engine->computer.beta_w_per_ghz3);
                  });
  section.section("radio",
                  [&](Section& radio)
                  {
                    radio.read("transmit_w", &engine->radio.transmit_w);
                    radio.read("receive_w", &engine->radio.receive_w);
                    radio.read("wait_w", &engine->radio.wait_w);
                    radio.read("tail_w", &engine->radio.tail_w);
                    radio.read("tail_s", &engine->radio.tail_s);
                  });
  section.section("policy",
                  [&](Section& policy)
                  {
                    PolicyOptions& options = engine->policy;
                    policy.read("miss_cost_j", &options.miss_cost_j);
                    policy.read("deviations", &options.deviations);
                    policy.read("residence_share", &options.residence_share);
                    policy.read("hysteresis", &options.hysteresis);
                    policy.read("fallback_factor", &options.fallback_factor);
                    policy.read("needed_capacity_gcycles", &options.needed_capacity_gcycles);
                    policy.read("scale_frequency", &options.scale_frequency);
                  });
}

void readAdmission(Section& section, AdmissionOptions* admission)
{
  section.read("max_queued", &admission->max_queued);
  section.read("max_queued_per_vehicle", &admission->max_queued_per_vehicle);
  section.read("lease_s", &admission->lease_s);
  section.read("lease_turn_s", &admission->lease_turn_s);
  section.read("max_leased_load", &admission->max_leased_load);
  section.read("fair_window_s", &admission->fair_window_s);
  section.read("max_vehicles", &admission->max_vehicles);
  section.readByKind("first_service_s", &admission->first_service_s);
  section.readByKind("served", &admission->served);
}

Scenario::Stream readStream(Section& section)
{
  Scenario::Stream stream;
  stream.kind = parseTaskKind(Section::convert<std::string>(section.node("kind"), section.name("kind")));
  section.read("rate_hz", &stream.rate_hz);
  section.read("regular", &stream.regular);
  section.read("deadline_s", &stream.deadline_s);
  section.read("work_gcycles", &stream.work_gcycles);
  section.read("local_s", &stream.local_s);
  section.read("local_deviation", &stream.local_deviation);
  section.read("local_j", &stream.local_j);
  section.read("input_bytes", &stream.input_bytes);
  section.read("output_bytes", &stream.output_bytes);
  return stream;
}

Scenario::Node readNode(Section& section)
{
  Scenario::Node node;
  node.description.id = Section::convert<std::string>(section.node("id"), section.name("id"));
  node.description.address = node.description.id + ":1";
  node.description.position = readPoint(section.node("position"), section.name("position"));
  node.description.range_m = Section::convert<double>(section.node("range_m"), section.name("range_m"));
  section.read("frequency_ghz", &node.description.frequency_ghz);
  section.read("workers", &node.workers);
  section.readByKind("service_s", &node.service_s);
  section.read("service_deviation", &node.service_deviation);
  return node;
}

void readNetwork(Section& section, Scenario::Network* network)
{
  section.read("rate_near_mbps", &network->rate_near_mbps);
  section.read("rate_edge_mbps", &network->rate_edge_mbps);
  section.read("shadowing_db", &network->shadowing_db);
  section.read("correlation_m", &network->correlation_m);
  section.read("round_trip_s", &network->round_trip_s);
  section.read("round_trip_deviation", &network->round_trip_deviation);
  section.read("loss", &network->loss);
  section.read("retransmission_s", &network->retransmission_s);
}

void readLoad(Section& section, Scenario::Load* load)
{
  section.read("base_load", &load->base_load);
  section.read("heavy_share", &load->heavy_share);
  section.read("heavy_load", &load->heavy_load);
  section.read("mean_burst_s", &load->mean_burst_s);
  section.read("task_s", &load->task_s);
  section.read("time_left", &load->time_left);
  section.read("vehicles", &load->vehicles);
  section.read("leases", &load->leases);
}

Scenario read(const YAML::Node& root)
{
  Scenario scenario;
  Section section(root, "");
  section.read("name", &scenario.name);
  section.read("duration_s", &scenario.duration_s);
  section.read("vehicles", &scenario.vehicles);
  section.read("speed", &scenario.speed);
  const YAML::Node route = section.node("route");
  if (!route.IsSequence())
  {
    throw std::invalid_argument("route must be a list of points [x, y]");
  }
  for (size_t i = 0; i < route.size(); ++i)
  {
    scenario.route.push_back(readPoint(route[i], "route[" + std::to_string(i) + "]"));
  }
  section.section("engine", [&](Section& engine) { readEngine(engine, &scenario.engine); });
  section.section("admission", [&](Section& admission) { readAdmission(admission, &scenario.admission); });
  section.list("streams", [&](Section& stream) { scenario.streams.push_back(readStream(stream)); });
  section.list("nodes", [&](Section& node) { scenario.nodes.push_back(readNode(node)); });
  section.section("network", [&](Section& network) { readNetwork(network, &scenario.network); });
  section.section("load", [&](Section& load) { readLoad(load, &scenario.load); });
  section.section("failures",
                  [&](Section& failures)
                  {
                    failures.read("mean_between_s", &scenario.failures.mean_between_s);
                    failures.read("mean_repair_s", &scenario.failures.mean_repair_s);
                  });
  section.finish();
  for (const Scenario::Stream& stream : scenario.streams)
  {
    TaskNeeds& needs = scenario.engine.needs[static_cast<size_t>(stream.kind)];
    needs.work_gcycles = stream.work_gcycles;
    needs.input_mbit = 8e-6 * static_cast<double>(stream.input_bytes);
    needs.output_mbit = 8e-6 * static_cast<double>(stream.output_bytes);
    needs.deadline_s = stream.deadline_s;
  }
  return scenario;
}

void validateStreams(const Scenario& scenario)
{
  std::set<TaskKind> kinds;
  for (const Scenario::Stream& stream : scenario.streams)
  {
    const std::string group = std::string("streams/") + toString(stream.kind);
    const pi_node::OptionCheck check(group);
    check.range("rate_hz", stream.rate_hz, 1e-3, 1000.0);
    check.range("deadline_s", stream.deadline_s, 1e-3, 60.0);
    check.range("work_gcycles", stream.work_gcycles, 0.0, 1e6);
    check.range("local_s", stream.local_s, 1e-6, 60.0);
    check.range("local_deviation", stream.local_deviation, 0.0, 3.0);
    check.range("local_j", stream.local_j, 1e-9, 1e6);
    check.range<size_t>("input_bytes", stream.input_bytes, 0, 1U << 25U);
    check.range<size_t>("output_bytes", stream.output_bytes, 0, 1U << 25U);
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
    const pi_node::OptionCheck check(group);
    check.range("workers", node.workers, 1, 1024);
    for (const double service_s : node.service_s)
    {
      check.range("service_s", service_s, 1e-6, 60.0);
    }
    check.range("service_deviation", node.service_deviation, 0.0, 3.0);
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
  const pi_node::OptionCheck check("");
  check.range("duration_s", duration_s, 1e-3, 1e6);
  check.range("vehicles", vehicles, 1, 10000);
  check.range("speed", speed, 0.0, 100.0);
  for (const Point& point : route)
  {
    check.range("route", point.x, -MOST_METRES, MOST_METRES);
    check.range("route", point.y, -MOST_METRES, MOST_METRES);
  }
  const simulation::LoopRoute loop(route);  // throws if it has no length
  const pi_node::OptionCheck net("network");
  net.range("rate_near_mbps", network.rate_near_mbps, 1e-3, 1e6);
  net.range("rate_edge_mbps", network.rate_edge_mbps, 1e-3, 1e6);
  net.range("shadowing_db", network.shadowing_db, 0.0, 30.0);
  net.range("correlation_m", network.correlation_m, 0.1, 1e6);
  net.range("round_trip_s", network.round_trip_s, 0.0, 60.0);
  net.range("round_trip_deviation", network.round_trip_deviation, 0.0, 3.0);
  net.range("loss", network.loss, 0.0, 1.0);
  net.range("retransmission_s", network.retransmission_s, 0.0, 60.0);
  const pi_node::OptionCheck others("load");
  others.range("base_load", load.base_load, 0.0, 100.0);
  others.range("heavy_share", load.heavy_share, 0.0, 1.0);
  others.range("heavy_load", load.heavy_load, 0.0, 100.0);
  others.range("mean_burst_s", load.mean_burst_s, 1e-3, 1e6);
  others.range("task_s", load.task_s, 1e-6, 60.0);
  others.range("time_left", load.time_left, 1e-3, 1.0);
  others.range("vehicles", load.vehicles, 1, 10000);
  const pi_node::OptionCheck faults("failures");
  faults.range("mean_between_s", failures.mean_between_s, 0.0, 1e9);
  faults.range("mean_repair_s", failures.mean_repair_s, 1e-3, 1e9);
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
  try
  {
    Scenario scenario = read(YAML::LoadFile(path));
    if (scenario.name.empty())
    {
      scenario.name = std::filesystem::path(path).stem().string();
    }
    scenario.validate();
    return scenario;
  }
  catch (const YAML::Exception& failure)
  {
    throw std::runtime_error(path + ": no YAML that can be read: " + failure.what());
  }
  catch (const std::invalid_argument& failure)
  {
    throw std::runtime_error(path + ": " + failure.what());
  }
}

}  // namespace pi_offload
