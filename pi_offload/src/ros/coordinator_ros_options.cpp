#include "ros/coordinator_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "engine/node_file.h"
#include "ros/range.h"
#include "ros/transport.h"
#include "wire/trusted_interfaces.h"

namespace pi_offload
{

namespace parameter_tree = pi_node::parameter_tree;
namespace parameters = pi_node::parameters;
using XmlRpc::XmlRpcValue;

namespace
{

constexpr size_t DETECTION = static_cast<size_t>(TaskKind::DETECTION);
constexpr size_t SPEECH = static_cast<size_t>(TaskKind::SPEECH);

NodeDescription nodeOf(XmlRpcValue value)
{
  parameters::requireType(value, XmlRpcValue::TypeStruct, "a map with id, address, x, y and range");
  NodeDescription node;
  Range range;
  for (auto& [name, member] : value)
  {
    try
    {
      if (name == "id" || name == "address")
      {
        parameters::read(member, name == "id" ? &node.id : &node.address);
      }
      else if (name == "x" || name == "y")
      {
        parameters::read(member, name == "x" ? &node.position.x : &node.position.y);
      }
      else if (name == "range")
      {
        read(member, &range);
      }
      else if (name == "frequency_ghz")
      {
        parameters::read(member, &node.frequency_ghz);
      }
      else
      {
        throw std::invalid_argument("means nothing here; there are id, address, x, y, range and frequency_ghz");
      }
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument(name + " " + error.what());
    }
  }
  node.range_m = range.metres;
  node.validate();
  return node;
}

}  // namespace

static void read(XmlRpcValue value, std::vector<NodeDescription>* field)
{
  parameters::requireType(value, XmlRpcValue::TypeArray, "a list of maps with id, address, x, y and range");
  field->clear();
  for (int i = 0; i < value.size(); ++i)
  {
    try
    {
      field->push_back(nodeOf(value[i]));
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument("node " + std::to_string(i + 1) + ": " + error.what());
    }
  }
}

static XmlRpcValue write(const std::vector<NodeDescription>& field)
{
  XmlRpcValue value;
  value.setSize(static_cast<int>(field.size()));
  for (size_t i = 0; i < field.size(); ++i)
  {
    XmlRpcValue& entry = value[static_cast<int>(i)];
    entry["id"] = field[i].id;
    entry["address"] = field[i].address;
    entry["x"] = field[i].position.x;
    entry["y"] = field[i].position.y;
    entry["frequency_ghz"] = field[i].frequency_ghz;
    entry["range"] = write(Range{field[i].range_m});
  }
  return value;
}

static void read(const XmlRpcValue& value, PictureMode* field)
{
  parameters::readChoice(value, {PictureMode::AUTO, PictureMode::JPEG, PictureMode::RAW}, field);
}

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(CoordinatorRosOptions& options, Visitor&& visit)
{
  auto& client = options.client;
  auto& engine = client.engine;
  auto& policy = engine.policy;
  auto& estimates = engine.estimates;
  visit("vehicle", options.vehicle);
  visit("map_frame", options.map_frame);
  visit("nodes_file", options.nodes_file);
  visit("nodes", options.nodes);
  visit("announcements", options.announcements);
  visit("max_nodes", options.max_nodes);
  visit("trusted_interfaces", client.link.trusted_interfaces);
  visit("transport", client.transport);
  visit("nats/servers", client.nats.servers);
  visit("nats/ca_file", client.nats.ca_file);
  visit("nats/certificate_file", client.nats.certificate_file);
  visit("nats/key_file", client.nats.key_file);
  visit("nats/network", client.network);
  visit("eta", engine.eta);
  visit("battery/eta_full", options.battery.eta_full);
  visit("battery/eta_empty", options.battery.eta_empty);
  visit("battery/charge_full", options.battery.charge_full);
  visit("battery/charge_empty", options.battery.charge_empty);
  visit("detection/deadline_s", engine.needs[DETECTION].deadline_s);
  visit("detection/local_s", options.detection_local_s);
  visit("speech/deadline_s", engine.needs[SPEECH].deadline_s);
  visit("speech/local_s", options.speech_local_s);
  visit("speech/max_calls", options.max_calls);
  visit("local/max_waiting", options.max_local_waiting);
  visit("local/lost_s", options.local_lost_s);
  visit("zero_copy", options.zero_copy);
  visit("max_rate_hz", options.max_rate_hz);
  visit("keep_order", options.keep_order);
  visit("use_runtime", client.use_runtime);
  visit("picture/encoding", client.encoder.mode);
  visit("picture/jpeg_quality", client.encoder.jpeg_quality);
  visit("picture/max_encoding", client.max_encoding);
  visit("policy/name", engine.policy_name);
  visit("policy/miss_cost_j", policy.miss_cost_j);
  visit("policy/deviations", policy.deviations);
  visit("policy/residence_share", policy.residence_share);
  visit("policy/hysteresis", policy.hysteresis);
  visit("policy/fallback_factor", policy.fallback_factor);
  visit("policy/needed_capacity_gcycles", policy.needed_capacity_gcycles);
  visit("policy/least_deviation_s", policy.least_deviation_s);
  visit("policy/loss_share", policy.loss_share);
  visit("policy/fallback_miss_share", policy.fallback_miss_share);
  visit("policy/hedge_share", policy.hedge_share);
  visit("policy/lost_j", policy.lost_j);
  visit("computer/frequency_ghz", engine.computer.frequency_ghz);
  visit("computer/static_w", engine.computer.static_w);
  visit("computer/beta_w_per_ghz3", engine.computer.beta_w_per_ghz3);
  visit("radio/transmit_w", engine.radio.transmit_w);
  visit("radio/receive_w", engine.radio.receive_w);
  visit("radio/wait_w", engine.radio.wait_w);
  visit("radio/tail_w", engine.radio.tail_w);
  visit("radio/tail_s", engine.radio.tail_s);
  visit("estimates/least_rate_mbps", estimates.least_rate_mbps);
  visit("estimates/first_rate_mbps", estimates.first_rate_mbps);
  visit("estimates/first_round_trip_s", estimates.first_round_trip_s);
  visit("estimates/memory_s", estimates.memory_s);
  visit("probes/period_s", engine.probe_period_s);
  visit("probes/period_far_s", engine.probe_period_far_s);
  visit("probes/valid_s", engine.advertisement_valid_s);
  visit("link/max_failures", engine.max_failures);
  visit("link/max_in_flight", engine.max_in_flight);
  visit("link/max_connections", client.max_connections);
  visit("link/connect_timeout_s", client.link.connect_timeout_s);
  visit("link/reconnect_s", client.link.reconnect_s);
  visit("link/max_reconnect_s", client.link.max_reconnect_s);
  visit("link/unanswered_s", client.unanswered_s);
  visit("verify/every", options.verify.every);
  visit("verify/suspect_every", options.verify.suspect_every);
  visit("verify/cool_down_s", options.verify.cool_down_s);
  visit("always_on", options.always_on);
  visit("odometry_timeout_s", options.odometry_timeout_s);
  visit("input_timeout_s", options.input_timeout_s);
  visit("marker_rate_hz", options.marker_rate_hz);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

void BatteryOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("eta_full", eta_full, 0.0, 1.0);
  check.range("eta_empty", eta_empty, 0.0, 1.0);
  check.range("charge_full", charge_full, 0.0, 1.0);
  check.range("charge_empty", charge_empty, 0.0, 1.0);
  parameters::require(charge_full > charge_empty, "charge_full", charge_full, "above charge_empty");
}

double BatteryOptions::eta(double charge) const
{
  const double part = std::clamp((charge - charge_empty) / (charge_full - charge_empty), 0.0, 1.0);
  return eta_empty + part * (eta_full - eta_empty);
}

CoordinatorRosOptions::CoordinatorRosOptions()
{
  client.link.max_queued_bytes = 8U << 20U;  // room for a raw picture beside others
  client.use_runtime = true;
}

void CoordinatorRosOptions::validate() const
{
  const pi_node::OptionCheck own("");
  TrustedInterfaces(client.link.trusted_interfaces).validate("trusted_interfaces");
  parameters::require(max_rate_hz >= 0.0 && max_rate_hz <= 1000.0, "max_rate_hz", max_rate_hz, "in [0, 1000]");
  parameters::require(!map_frame.empty(), "map_frame", "\"\"", "the name of a frame");
  parameters::require(vehicle.size() <= 64, "vehicle", "\"" + vehicle + "\"", "at most 64 bytes");
  parameters::require(nodes_file.empty() || nodes_file.front() == '/', "nodes_file", "\"" + nodes_file + "\"",
                      "an absolute path, or empty for none: a node's working folder is not its user's");
  own.range<size_t>("max_nodes", max_nodes, 1, 10000);
  parameters::require(nodes.size() <= max_nodes, "nodes", std::to_string(nodes.size()) + " nodes", "at most max_nodes");
  for (const NodeDescription& node : nodes)
  {
    parameters::require(!node.address.empty(), "nodes: address", "\"\" of " + node.id, "host:port");
  }
  try
  {
    requireUniqueIds(nodes);
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string("nodes: ") + error.what());
  }
  own.range("eta", client.engine.eta, 0.0, 1.0);
  parameter_tree::validateGroup("battery", battery);
  own.range("detection/deadline_s", client.engine.needs[DETECTION].deadline_s, 0.001, 60.0);
  own.range("detection/local_s", detection_local_s, 0.0001, 60.0);
  own.range("speech/deadline_s", client.engine.needs[SPEECH].deadline_s, 0.001, 60.0);
  own.range("speech/local_s", speech_local_s, 0.0001, 60.0);
  own.range("speech/max_calls", max_calls, 1, 64);
  own.range<size_t>("local/max_waiting", max_local_waiting, 1, 100);
  own.range("local/lost_s", local_lost_s, 0.05, 60.0);
  own.range("picture/jpeg_quality", client.encoder.jpeg_quality, 1, 100);
  own.range<size_t>("picture/max_encoding", client.max_encoding, 1, 64);
  const std::vector<std::string>& policies = policyNames();
  std::string names;
  for (const std::string& name : policies)
  {
    names += (names.empty() ? "" : ", ") + name;
  }
  parameters::require(std::find(policies.begin(), policies.end(), client.engine.policy_name) != policies.end(),
                      "policy/name", "\"" + client.engine.policy_name + "\"", ("one of " + names).c_str());
  client.engine.policy.validate();
  client.engine.computer.validate();
  client.engine.radio.validate();
  client.engine.estimates.validate();
  own.range("probes/period_s", client.engine.probe_period_s, 0.01, 60.0);
  own.range("probes/period_far_s", client.engine.probe_period_far_s, 0.01, 3600.0);
  own.range("probes/valid_s", client.engine.advertisement_valid_s, 0.02, 3600.0);
  own.range("link/max_failures", client.engine.max_failures, 1, 1000);
  own.range<size_t>("link/max_in_flight", client.engine.max_in_flight, 1, 10000);
  own.range<size_t>("link/max_connections", client.max_connections, 1, 1000);
  own.range("link/unanswered_s", client.unanswered_s, 0.05, 60.0);
  SpRequester::Options link = client.link;
  link.address = "localhost:1";
  parameter_tree::validateGroup("link", link);
  clientOptions("some").validate();
  parameter_tree::validateGroup("verify", verify);
  parameter_tree::requireDuration("odometry_timeout_s", odometry_timeout_s);
  parameter_tree::requireDuration("input_timeout_s", input_timeout_s);
  own.range("marker_rate_hz", marker_rate_hz, 0.1, 50.0);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

OffloadClientOptions CoordinatorRosOptions::clientOptions(const std::string& name) const
{
  OffloadClientOptions complete = client;
  complete.vehicle = vehicle.empty() ? name : vehicle;
  EngineOptions& engine = complete.engine;
  engine.needs[DETECTION].work_gcycles = detection_local_s * engine.computer.frequency_ghz;
  engine.needs[SPEECH].work_gcycles = speech_local_s * engine.computer.frequency_ghz;
  engine.computer.least_frequency_ghz = std::min(engine.computer.least_frequency_ghz, engine.computer.frequency_ghz);
  // At worst all waiting pictures are given up one after the other.
  engine.local_lost_s = std::min(3600.0, local_lost_s * static_cast<double>(max_local_waiting + 2));
  if (client.transport == Transport::NATS && !client.nats.servers.empty())
  {
    complete.max_connections = std::max<size_t>(1, complete.max_connections - 1);  // NodeSources has one
  }
  complete.encoder.max_raw_bytes = complete.link.max_queued_bytes / 2;
  return complete;
}

}  // namespace pi_offload

template struct pi_node::NodeParameters<pi_offload::CoordinatorRosOptions>;
