#include "ros/edge_server_ros_options.h"

#include <pi_detect/model_catalogue.h>
#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>
#include <pi_node/ros/yaml_parameters.h>
#include <ros/package.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <system_error>

#include "ros/transport.h"
#include "wire/socket_tools.h"
#include "wire/trusted_interfaces.h"

namespace pi_offload
{

namespace parameter_tree = pi_node::parameter_tree;
namespace parameters = pi_node::parameters;
using XmlRpc::XmlRpcValue;

namespace
{

constexpr uint16_t PORT = 5680;
constexpr uint16_t HEALTH_PORT = 5681;
constexpr size_t SERVED_DETECTION = static_cast<size_t>(TaskKind::DETECTION);
constexpr size_t SERVED_SPEECH = static_cast<size_t>(TaskKind::SPEECH);

std::string hostName()
{
  char name[256] = "";
  gethostname(name, sizeof name - 1);
  return name[0] != '\0' ? name : "localhost";
}

void requirePath(const char* name, const std::string& path)
{
  parameters::require(path.empty() || path.front() == '/', name, "\"" + path + "\"",
                      "an absolute path, or empty for the package's own");
}

/// A file or folder in a package's share folder: in the install space of the running program, else as ROS finds the
/// package. Empty if it is in neither.
std::string packageFile(const std::string& package, const std::string& name)
{
  namespace fs = std::filesystem;
  std::error_code ignored;
  // PREFIX/lib/pi_offload/PROGRAM and PREFIX/share/PACKAGE
  const fs::path prefix = fs::read_symlink("/proc/self/exe", ignored).parent_path().parent_path().parent_path();
  const fs::path installed = prefix / "share" / package / name;
  if (fs::exists(installed, ignored))
  {
    return installed.string();
  }
  const std::string path = ros::package::getPath(package);
  return !path.empty() && fs::exists(fs::path(path) / name, ignored) ? path + "/" + name : "";
}

/// @throws std::runtime_error naming the file and the parameter in its place.
std::string packaged(const char* package, const char* name, const char* parameter)
{
  std::string path = packageFile(package, name);
  if (path.empty())
  {
    throw std::runtime_error(std::string(package) + "'s " + name +
                             " is not there; source the workspace's setup.sh, or set " + parameter);
  }
  return path;
}

pi_detect::ChosenModel chosenModel(const EdgeServerRosOptions& options)
{
  const std::string& model = options.detector.model;
  const std::string models =
      pi_detect::isModelPath(model) ? "" : packaged("pi_detect", "config/models", "detection/model");
  return pi_detect::chooseModel(model, models);
}

}  // namespace

}  // namespace pi_offload

namespace pi_detect
{

static void read(const XmlRpc::XmlRpcValue& value, Target* field)
{
  pi_node::parameters::readChoice(value, {Target::CPU, Target::OPENCL, Target::OPENCL_FP16}, field);
}

}  // namespace pi_detect

namespace pi_speech
{

static void read(const XmlRpc::XmlRpcValue& value, RecognitionMode* field)
{
  pi_node::parameters::readChoice(value, {RecognitionMode::SAFE, RecognitionMode::CLOSED}, field);
}

}  // namespace pi_speech

namespace pi_offload
{

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(EdgeServerRosOptions& options, Visitor&& visit)
{
  auto& server = options.server;
  auto& admission = server.admission;
  auto& detector = options.detector;
  auto& recognizer = options.recognizer;
  visit("id", options.id);
  visit("address", options.address);
  visit("host", server.replier.host);
  visit("port", options.port);
  visit("trusted_interfaces", server.replier.trusted_interfaces);
  visit("transport", server.transport);
  visit("nats/servers", server.nats.servers);
  visit("nats/ca_file", server.nats.ca_file);
  visit("nats/certificate_file", server.nats.certificate_file);
  visit("nats/key_file", server.nats.key_file);
  visit("map_frame", options.map_frame);
  visit("has_position", server.has_position);
  visit("x", server.position.x);
  visit("y", server.position.y);
  visit("range", options.range);
  visit("admission/frequency_ghz", admission.frequency_ghz);
  visit("admission/workers", admission.workers);
  visit("admission/max_queued", admission.max_queued);
  visit("admission/max_queued_per_vehicle", admission.max_queued_per_vehicle);
  visit("server/max_payload_mb", options.max_payload_mb);
  visit("server/max_task_s", server.max_task_s);
  visit("admission/fair_window_s", admission.fair_window_s);
  visit("admission/max_vehicles", admission.max_vehicles);
  visit("replier/max_connections", server.replier.max_connections);
  visit("replier/idle_timeout_s", server.replier.idle_timeout_s);
  visit("admission/lease_s", admission.lease_s);
  visit("admission/lease_turn_s", admission.lease_turn_s);
  visit("admission/max_leased_load", admission.max_leased_load);
  visit("detection/enabled", options.detection);
  visit("detection/model", detector.model);
  visit("detection/target", detector.detector.target);
  visit("detection/require_target", detector.detector.require_target);
  visit("detection/threads", detector.detector.threads);
  visit("detection/check_model", detector.detector.check_model);
  visit("detection/score_threshold", detector.detector.filter.score_threshold);
  visit("detection/max_detections", detector.detector.filter.max_detections);
  visit("detection/max_side", detector.max_side);
  visit("detection/first_service_s", admission.first_service_s[SERVED_DETECTION]);
  visit("speech/enabled", options.speech);
  visit("speech/commands", options.commands);
  visit("speech/mode", recognizer.recognizer.mode);
  visit("speech/threshold", recognizer.recognizer.threshold);
  visit("speech/max_sound_s", recognizer.max_sound_s);
  visit("speech/max_commands", recognizer.max_commands);
  visit("speech/max_tables", recognizer.max_tables);
  visit("speech/first_service_s", admission.first_service_s[SERVED_SPEECH]);
  visit("health/enabled", options.health);
  visit("health/host", options.health_endpoint.host);
  visit("health/port", options.health_port);
  visit("drain_s", options.drain_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

EdgeServerRosOptions::EdgeServerRosOptions()
{
  port = PORT;
  health_port = HEALTH_PORT;
  server.nats.servers = {"127.0.0.1:4222"};
  detector.model = "accurate";
  detector.detector.threads = 1;
}

void EdgeServerRosOptions::validate() const
{
  const pi_node::OptionCheck own("");
  TrustedInterfaces(server.replier.trusted_interfaces).validate("trusted_interfaces");
  own.range("port", port, 0, 65535);
  own.range("health/port", health_port, 0, 65535);
  parameters::require(std::isfinite(server.position.x), "x", server.position.x, "finite");
  parameters::require(std::isfinite(server.position.y), "y", server.position.y, "finite");
  parameters::require(range.metres >= 0.0, "range", range.metres, "at least 0");
  own.range("detection/first_service_s", server.admission.first_service_s[SERVED_DETECTION], 1e-6, 3600.0);
  own.range("speech/first_service_s", server.admission.first_service_s[SERVED_SPEECH], 1e-6, 3600.0);
  parameters::require(!map_frame.empty(), "map_frame", "\"\"", "the name of a frame");
  own.range<size_t>("server/max_payload_mb", max_payload_mb, 1, 65536);
  parameters::require(detection || speech, "detection/enabled and speech/enabled", "false", "true for one at least");
  parameters::require(!pi_detect::isModelPath(detector.model) || detector.model.front() == '/', "detection/model",
                      "\"" + detector.model + "\"", "the name of a network or an absolute path");
  requirePath("speech/commands", commands);
  serverOptions().validate();
  detector.detector.validate();
  own.range<uint32_t>("detection/max_side", detector.max_side, 2, 65535);
  own.range("speech/threshold", recognizer.recognizer.threshold, 0.001, 0.999);
  own.range("speech/max_sound_s", recognizer.max_sound_s, 0.1, 300.0);
  own.range<size_t>("speech/max_commands", recognizer.max_commands, 1, 10000);
  own.range<size_t>("speech/max_tables", recognizer.max_tables, 1, 100);
  own.range("drain_s", drain_s, 0.0, 3600.0);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
  NodeDescription node;
  const EdgeNode announced = announcement(PORT);
  node.id = announced.id;
  node.address = announced.address;
  node.position = server.position;
  node.range_m = range.metres;
  node.validate();
}

EdgeServerOptions EdgeServerRosOptions::serverOptions() const
{
  EdgeServerOptions complete = server;
  complete.replier.port = static_cast<uint16_t>(port);
  complete.range_m = range.metres;
  complete.max_payload_bytes = max_payload_mb << 20U;
  complete.admission.served = {detection, speech};
  complete.site = id.empty() ? hostName() : id;
  complete.network =
      pi_detect::isModelPath(detector.model) ? std::filesystem::path(detector.model).stem().string() : detector.model;
  complete.address = server.transport == Transport::NATS ? announcement(0).address : "";
  return complete;
}

HealthEndpoint::Options EdgeServerRosOptions::healthOptions() const
{
  HealthEndpoint::Options complete = health_endpoint;
  complete.port = static_cast<uint16_t>(health_port);
  return complete;
}

std::array<ExecutorFactory, TASK_KINDS> EdgeServerRosOptions::executors() const
{
  std::array<ExecutorFactory, TASK_KINDS> factories;
  if (detection)
  {
    DetectionExecutorOptions complete = detector;
    complete.model = chosenModel(*this).description.path;
    factories[SERVED_DETECTION] = detectionExecutor(complete);
  }
  if (speech)
  {
    SpeechExecutorOptions complete = recognizer;
    pi_speech::RecognizerOptions& models = complete.recognizer;
    models.garbage_words = packaged("pi_speech", "config/garbage_words.txt", "speech/enabled to false");
    models.confidence = packaged("pi_speech", "config/confidence.yaml", "speech/enabled to false");
    models.word_network = packageFile("pi_speech", "config/word_network.bin");  // these two are not in each package
    models.sphinx.adaptation = packageFile("pi_speech", "config/adaptation");
    complete.commands = pi_speech::CommandTable::load(
        commands.empty() ? packaged("pi_speech", "config/commands.yaml", "speech/commands") : commands);
    factories[SERVED_SPEECH] = speechExecutor(complete);
  }
  return factories;
}

std::string EdgeServerRosOptions::detectionModel(std::string* notice) const
{
  if (!detection)
  {
    return "";
  }
  pi_detect::ChosenModel chosen = chosenModel(*this);
  *notice = std::move(chosen.notice);
  return chosen.description.name;
}

EdgeNode EdgeServerRosOptions::announcement(uint16_t listening_port) const
{
  EdgeNode node;
  HostPort at{server.replier.host, listening_port};
  if (server.transport == Transport::NATS && !server.nats.servers.empty())
  {
    at = parseHostPort("nats/servers", server.nats.servers.front());  // the vehicles' way to it
    at.host = server.nats.tls() && isLoopback(at.host) ? hostName() : at.host;
  }
  const std::string host = at.host == "0.0.0.0" || at.host == "::" ? hostName() : at.host;
  node.id = id.empty() ? hostName() : id;
  node.address = address.empty()
                     ? (host.find(':') == std::string::npos ? host : "[" + host + "]") + ":" + std::to_string(at.port)
                     : address;
  node.frame_id = map_frame;
  node.x = server.position.x;
  node.y = server.position.y;
  node.range = range.metres;
  node.frequency_ghz = server.admission.frequency_ghz;
  return node;
}

EdgeServerRosOptions EdgeServerRosOptions::loadFile(const std::string& path, std::vector<std::string>* unknown)
{
  try
  {
    const YAML::Node file = YAML::LoadFile(path);
    if (!file.IsMap() && !file.IsNull())
    {
      throw std::invalid_argument("is no map of parameters");
    }
    return fromParameters(file.IsMap() ? pi_node::fromYaml(file) : XmlRpcValue(), "", unknown);
  }
  catch (const YAML::BadFile&)
  {
    throw std::runtime_error(path + ": cannot be read; config/edge_server.yaml shows what it should say");
  }
  catch (const std::exception& error)
  {
    throw std::runtime_error(path + ": " + error.what());
  }
}

}  // namespace pi_offload

template struct pi_node::NodeParameters<pi_offload::EdgeServerRosOptions>;
