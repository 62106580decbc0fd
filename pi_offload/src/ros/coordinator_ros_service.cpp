// The thread offload_service of CoordinatorRos.

#include <pi_offload/OffloadDecision.h>
#include "ros/conversions.h"
#include "ros/coordinator_ros.h"
#include <pi_node/formatting.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <utility>

#include "wire/durations.h"

namespace pi_offload
{
namespace
{

using pi_node::format;

constexpr double WATCH_PERIOD_S = 0.2;
constexpr size_t MOST_WAITING_NODES = 256;
constexpr double ETA_STEP = 0.005;  ///< smaller changes by the battery do not count

}  // namespace

void CoordinatorRos::advertise()
{
  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  detections_ = service_node_.advertise<pi_detect::Detection2DArray>("detections", 10, look, look);
  const auto detector = [this](const ros::SingleSubscriberPublisher&)
  { client_->post([this](int64_t now_ns) { giveToDetector(now_ns); }); };
  local_image_ = service_node_.advertise<sensor_msgs::Image>("local/image", 2, detector, detector);
  decisions_ = service_private_node_.advertise<OffloadDecision>("decisions", 100);
  const auto draw = [this](const ros::SingleSubscriberPublisher&) { publishMarkers(); };
  markers_ = service_private_node_.advertise<visualization_msgs::MarkerArray>(
      "markers", 1, draw, ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);

  services_.push_back(service_private_node_.advertiseService("decide", &CoordinatorRos::decide, this));
  services_.push_back(service_private_node_.advertiseService("nodes", &CoordinatorRos::nodes, this));
  services_.push_back(service_private_node_.advertiseService("register_node", &CoordinatorRos::registerNode, this));
  services_.push_back(service_private_node_.advertiseService("set_policy", &CoordinatorRos::setPolicy, this));
  services_.push_back(service_private_node_.advertiseService("set_eta", &CoordinatorRos::setEta, this));
  services_.push_back(service_private_node_.advertiseService("statistics", &CoordinatorRos::statistics, this));
  services_.push_back(service_private_node_.advertiseService("enable", &CoordinatorRos::enable, this));
  ros::NodeHandle speech_node(service_node_);
  speech_node.setCallbackQueue(&speech_queue_);
  utterances_ = speech_node.advertiseService("recognize_utterance", &CoordinatorRos::recognizeUtterance, this);

  const auto every = [this](double period_s, void (CoordinatorRos::*function)())
  {
    timers_.push_back(service_node_.createWallTimer(
        ros::WallDuration(period_s), [this, function](const ros::WallTimerEvent&) { (this->*function)(); }));
  };
  every(options_.diagnostic_period, &CoordinatorRos::publishDiagnostics);
  every(WATCH_PERIOD_S, &CoordinatorRos::watch);
  every(1.0 / options_.marker_rate_hz, &CoordinatorRos::publishMarkers);
}

void CoordinatorRos::subscribe()
{
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  subscribers_.push_back(input_node_.subscribe("local/labels", 1, &CoordinatorRos::onLabels, this, hints));
  subscribers_.push_back(service_node_.subscribe("odometry", 1, &CoordinatorRos::onOdometry, this, hints));
  subscribers_.push_back(service_node_.subscribe("route", 1, &CoordinatorRos::onRoute, this, hints));
  subscribers_.push_back(service_node_.subscribe("battery", 1, &CoordinatorRos::onBattery, this, hints));
  if (options_.announcements)
  {
    subscribers_.push_back(service_node_.subscribe("edge_nodes", 256, &CoordinatorRos::onEdgeNode, this, hints));
  }
}

void CoordinatorRos::say(const std::string& problem)
{
  if (!problem.empty())
  {
    warnings_.warn(problem);
  }
}

void CoordinatorRos::updateSubscription()
{
  const bool wanted = options_.always_on || detections_.getNumSubscribers() > 0;
  if (wanted == subscribed_)
  {
    return;
  }
  subscribed_ = wanted;
  if (!wanted)
  {
    image_.shutdown();
    local_detections_.shutdown();
    client_->post(
        [this](int64_t now_ns)
        {
          for (const LocalQueue::Entry& entry : local_.clear())
          {
            client_->engine().onLocalFailed(entry.task, "nobody listens any more", now_ns);
          }
        });
    return;
  }
  came_at_ns_ = monotonicNs();
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  local_detections_ = input_node_.subscribe("local/detections", 8, &CoordinatorRos::onLocalDetections, this, hints);
  image_ = pi_os_transport::zero_copy::subscribeImages(
      input_node_, "image", 8, options_.zero_copy,
      [this](const pi_os_transport::zero_copy::ImageHandle& message) { onImage(message); }, hints);
}

// ------------------------------------------------------------------------------------------------------- the vehicle

void CoordinatorRos::onOdometry(const nav_msgs::OdometryConstPtr& message)
{
  std::string problem;
  const auto transform = map_.from(message->header.frame_id, &problem);
  say(problem.empty() ? "" : "odometry: " + problem + "; without it nodes of finite range are not used");
  if (!transform)
  {
    return;
  }
  const VehicleState state = fromMsg(*message, *transform);
  if (!state.known)
  {
    say("odometry: pose or speed is not finite; message ignored");
    return;
  }
  odometry_at_ns_ = monotonicNs();
  vehicle_ = state;
  client_->post([this, state](int64_t) { client_->engine().setVehicle(state); });
}

void CoordinatorRos::onRoute(const nav_msgs::PathConstPtr& message)
{
  std::string problem;
  const auto transform = map_.from(message->header.frame_id, &problem);
  if (!transform)
  {
    say("route: tf has no " + map_.name() + " -> " + message->header.frame_id +
        "; this route is ignored, publish it again once there is one");
    return;
  }
  try
  {
    const std::vector<Point> route = fromMsg(*message, *transform);
    client_->call([this, &route](int64_t) { client_->engine().setRoute(route); });
  }
  catch (const std::exception& error)
  {
    say(std::string("route: ") + error.what() + "; the former one stays");
  }
}

void CoordinatorRos::onBattery(const sensor_msgs::BatteryStateConstPtr& message)
{
  const std::optional<double> charge = chargeOf(*message);
  if (!charge)
  {
    if (!std::isnan(message->percentage))  // NaN: not measured
    {
      say(format("battery: percentage = %g", static_cast<double>(message->percentage)) +
          ", must be in [0, 1], or NaN if it is not measured; eta stays as it is");
    }
    return;
  }
  charge_ = charge;
  const double eta = options_.battery.eta(*charge);
  if (eta_by_battery_)
  {
    client_->call(
        [this, eta](int64_t)
        {
          if (std::abs(client_->eta() - eta) >= ETA_STEP)
          {
            client_->setEta(eta);
          }
        });
  }
}

void CoordinatorRos::watch()
{
  updateSubscription();  // also when somebody left without saying so
  if (vehicle_.known && seconds(monotonicNs() - odometry_at_ns_) > options_.odometry_timeout_s)
  {
    vehicle_ = VehicleState();
    client_->post([this](int64_t) { client_->engine().setVehicle(VehicleState()); });
    say(format("odometry: nothing for %.1f s", options_.odometry_timeout_s) + "; nodes of finite range are not used");
  }
  for (auto waiting = waiting_nodes_.begin(); waiting != waiting_nodes_.end();)
  {
    std::string problem;
    const bool known = addNode(waiting->second, &problem);
    say(problem);
    waiting = known ? waiting_nodes_.erase(waiting) : std::next(waiting);
  }
}

// -------------------------------------------------------------------------------------------------------------- nodes

bool CoordinatorRos::addNode(const EdgeNode& message, std::string* problem)
{
  problem->clear();
  try
  {
    NodeDescription node = fromMsg(message);
    std::string missing;
    const auto transform = map_.from(message.frame_id, &missing);
    if (!transform)
    {
      *problem = missing.empty() ? "" : "node " + node.id + ": " + missing;
      return false;
    }
    const Eigen::Vector3d p_map = *transform * Eigen::Vector3d(node.position.x, node.position.y, 0.0);
    node.position = {p_map.x(), p_map.y()};
    client_->call(
        [this, &node, problem](int64_t now_ns)
        {
          const std::vector<OffloadEngine::NodeStatus> nodes = client_->engine().nodes(now_ns);
          const bool is_new = std::none_of(nodes.begin(), nodes.end(),
                                           [&node](const auto& other) { return other.description.id == node.id; });
          if (is_new && nodes.size() >= options_.max_nodes)
          {
            *problem = "node " + node.id + " is one too many: max_nodes = " + std::to_string(options_.max_nodes);
            return;
          }
          client_->setNode(node, now_ns);
        });
  }
  catch (const std::exception& error)
  {
    *problem = error.what();
  }
  return true;
}

void CoordinatorRos::onEdgeNode(const EdgeNodeConstPtr& message)
{
  std::string problem;
  if (!addNode(*message, &problem) && waiting_nodes_.size() < MOST_WAITING_NODES)
  {
    waiting_nodes_[message->id] = *message;
  }
  say(problem.empty() ? "" : "edge_nodes: " + problem);
}

bool CoordinatorRos::registerNode(RegisterNode::Request& request, RegisterNode::Response& response)
{
  if (request.remove != 0)
  {
    const std::string& id = request.node.id;
    waiting_nodes_.erase(id);
    response.success =
        static_cast<uint8_t>(client_->call([this, &id](int64_t now_ns) { return client_->removeNode(id, now_ns); }));
    response.message = response.success != 0 ? "removed " + id : "there is no node \"" + id + "\"";
    return true;
  }
  std::string problem;
  if (!addNode(request.node, &problem))
  {
    problem = "tf has no " + map_.name() + " -> " + request.node.frame_id + "; give the position in " + map_.name();
  }
  response.success = static_cast<uint8_t>(problem.empty());
  response.message = problem.empty() ? "knows " + request.node.id + " at " + request.node.address : problem;
  return true;
}

bool CoordinatorRos::nodes(Nodes::Request&, Nodes::Response& response)
{
  for (const OffloadEngine::NodeStatus& status :
       client_->call([this](int64_t now_ns) { return client_->engine().nodes(now_ns); }))
  {
    response.nodes.push_back(toMsg(status, map_.name()));
  }
  return true;
}

// ----------------------------------------------------------------------------------------------------------- services

bool CoordinatorRos::decide(Decide::Request& request, Decide::Response& response)
{
  try
  {
    const TaskKind kind = parseTaskKind(request.kind);
    if (!(request.deadline >= 0.0 && request.deadline <= 3600.0))
    {
      throw std::invalid_argument(format("deadline = %g", request.deadline) + ", must be in [0, 3600]");
    }
    if (!(request.input_bytes >= 0.0 && request.input_bytes <= static_cast<double>(MAX_PAYLOAD)))
    {
      throw std::invalid_argument(format("input_bytes = %g", request.input_bytes) +
                                  format(", must be in [0, %.0f]", static_cast<double>(MAX_PAYLOAD)));
    }
    client_->call(
        [&](int64_t now_ns)
        {
          const size_t last = client_->lastInputBytes(kind);
          const double usual = 1e6 / 8.0 * options_.client.engine.needs[static_cast<size_t>(kind)].input_mbit;
          const auto bytes = request.input_bytes > 0.0 ? static_cast<size_t>(request.input_bytes)
                             : last > 0                ? last
                                                       : static_cast<size_t>(usual);
          const auto begin = std::chrono::steady_clock::now();
          const Decision decision = client_->engine().decide(kind, bytes, request.deadline, now_ns);
          response.decision_time = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
          if (decision.node >= 0)
          {
            response.node = client_->engine().nodes(now_ns).at(static_cast<size_t>(decision.node)).description.id;
          }
          response.expected_time = decision.expected_s;
          response.expected_energy = decision.expected_j;
          response.expected_misses = decision.expected_misses;
          response.timeout = decision.timeout_s;
          response.reason = decision.reason;
        });
    response.success = 1;
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

bool CoordinatorRos::setPolicy(SetPolicy::Request& request, SetPolicy::Response& response)
{
  try
  {
    PolicyOptions policy = policy_;
    if (request.miss_cost != 0.0)
    {
      policy.miss_cost_j = request.miss_cost;
      policy.validate();
    }
    const std::string name = request.policy.empty() ? policy_name_ : request.policy;
    client_->call(
        [&](int64_t)
        {
          client_->engine().setPolicy(name);
          client_->engine().setPolicyOptions(policy);
        });
    policy_ = policy;
    policy_name_ = name;
    response.success = 1;
    response.message = "policy " + name + format(", %g J per missed deadline", policy.miss_cost_j);
    ROS_INFO_STREAM_NAMED("coordinator", response.message);
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  response.policy = policy_name_;
  response.miss_cost = policy_.miss_cost_j;
  response.policies = policyNames();
  return true;
}

bool CoordinatorRos::setEta(SetEta::Request& request, SetEta::Response& response)
{
  try
  {
    const double eta = !request.by_battery ? request.eta
                       : charge_           ? options_.battery.eta(*charge_)
                                           : options_.client.engine.eta;
    client_->call([this, eta](int64_t) { client_->setEta(eta); });
    eta_by_battery_ = request.by_battery != 0;
    response.success = 1;
    response.message = !eta_by_battery_ ? "eta holds until by_battery"
                       : charge_        ? format("the battery decides, %.0f %% full", 100.0 * *charge_)
                                        : "the battery decides once it says how full it is";
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  response.eta = client_->call([this](int64_t) { return client_->eta(); });
  return true;
}

bool CoordinatorRos::statistics(Statistics::Request&, Statistics::Response& response)
{
  const CoordinatorFigures figures = client_->call([this](int64_t now_ns) { return this->figures(now_ns); });
  response.enabled = static_cast<uint8_t>(figures.enabled);
  response.policy = policy_name_;
  response.eta = figures.eta;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    response.kinds.push_back(
        toMsg(static_cast<TaskKind>(kind), figures.statistics.of_kind[kind], figures.p50_s[kind], figures.p99_s[kind]));
  }
  return true;
}

bool CoordinatorRos::enable(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response)
{
  const bool enabled = request.data != 0;
  client_->call([this, enabled](int64_t now_ns) { client_->setEnabled(enabled, now_ns); });
  response.success = 1;
  response.message = enabled ? "tasks may go to nodes" : "the vehicle does everything";
  ROS_INFO_STREAM_NAMED("coordinator", response.message);
  return true;
}

// ------------------------------------------------------------------------------------------------------------ reports

void CoordinatorRos::publishMarkers()
{
  if (markers_.getNumSubscribers() == 0)
  {
    return;
  }
  const CoordinatorFigures figures = client_->call([this](int64_t now_ns) { return this->figures(now_ns); });
  markers_.publish(node_markers_.update(figures.nodes, vehicle_, figures.last_node, ros::Time::now()));
}

void CoordinatorRos::publishDiagnostics()
{
  CoordinatorFigures figures = client_->call(
      [this](int64_t now_ns)
      {
        if (local_.busy() || local_.waiting() > 0)
        {
          giveToDetector(now_ns);  // what it did not answer is given up
        }
        return this->figures(now_ns);
      });
  figures.topic = topic_;
  figures.subscribed = subscribed_;
  figures.pictures = pictures_came_;
  figures.silent_s = seconds(monotonicNs() - came_at_ns_);
  figures.crowded = pictures_crowded_;
  figures.vehicle = vehicle_name_;
  figures.policy = policy_name_;
  figures.position_known = vehicle_.known;
  figures.position = vehicle_.known         ? "known"
                     : odometry_at_ns_ == 0 ? "not known, no odometry that fits came"
                                            : "not known, no odometry comes any more";
  if (figures.subscribed && figures.silent_s > options_.input_timeout_s)
  {
    warnings_.warn(topic_ + format(": nothing for %.1f s", figures.silent_s) +
                   "; check that the camera runs and that the topic is its");
  }
  if (figures.waiting > 0 && (figures.model.empty() || !figures.detector_listens))
  {
    warnings_.warn("pictures wait for the vehicle's detector, which " +
                   std::string(figures.model.empty() ? "has not said its network on local/labels"
                                                     : "does not listen to local/image") +
                   "; is pi_detect's ssd loaded and remapped?");
  }
  diagnostics_.update(figures);
}

}  // namespace pi_offload
