#include "ros/coordinator_ros.h"

#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <unistd.h>
#include <visualization_msgs/MarkerArray.h>

namespace pi_offload
{
namespace
{

using pi_node::format;

constexpr double WATCH_PERIOD_S = 0.2;

/// Host and node name: two coordinators on one computer have two names.
std::string defaultVehicle(const std::string& node_name)
{
  char host[256] = "";
  gethostname(host, sizeof host - 1);
  std::string name = host + node_name;
  constexpr size_t LONGEST = 64;
  return name.size() <= LONGEST ? name : name.substr(name.size() - LONGEST);
}

}  // namespace

CoordinatorRos::CoordinatorRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : input_thread_("offload_input")
  , service_thread_("offload_service")
  , service_node_(service_thread_.handle(node))
  , service_private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<CoordinatorRosOptions>(private_node, "coordinator"))
  , vehicle_name_(options_.vehicle.empty() ? defaultVehicle(private_node.getNamespace()) : options_.vehicle)
  , policy_name_(options_.client.engine.policy_name)
  , policy_(options_.client.engine.policy)
  , warnings_(options_.warning_period_s, pi_node::warningLog<CoordinatorRosOptions>("coordinator"))
  , diagnostics_(service_node_, private_node, &warnings_, options_.input_timeout_s)
  , map_(node, options_.map_frame)
  , node_markers_(options_.map_frame)
  , client_(options_.clientOptions(vehicle_name_), clientCallbacks())
  , ledger_(service_private_node_, options_.speech_local_s)
  , checks_(options_.verify)
  , node_sources_(service_node_, &options_, &client_, &checks_, &map_, &warnings_)
  , pictures_(input_thread_.handle(node), service_node_, &options_, &client_, &checks_, &ledger_, &warnings_)
  , utterances_(service_node_, &options_, &client_, &ledger_, &warnings_)
  , vehicle_(service_node_, &options_, &client_, &map_, &warnings_)
{
  advertise();
  client_.start();
  utterances_.start();
  input_thread_.start();
  service_thread_.start();
}

CoordinatorRos::~CoordinatorRos()
{
  utterances_.stop();
  input_thread_.stop();
  service_thread_.stop();
  client_.stop();
}

OffloadClient::Callbacks CoordinatorRos::clientCallbacks()
{
  OffloadClient::Callbacks callbacks;
  callbacks.run_local = [this](const Task& task)
  { task.kind == TaskKind::SPEECH ? utterances_.runLocal(task) : pictures_.runLocal(task); };
  callbacks.deliver = [this](const Outcome& outcome, const OffloadReply* reply)
  { outcome.task.kind == TaskKind::SPEECH ? utterances_.deliver(outcome, reply) : pictures_.deliver(outcome, reply); };
  callbacks.log = [this](bool error, const std::string& text) { error ? warnings_.error(text) : warnings_.warn(text); };
  callbacks.next_time = [this] { return pictures_.nextTime(); };
  callbacks.on_time = [this](int64_t now_ns) { pictures_.onTime(now_ns); };
  return callbacks;
}

void CoordinatorRos::advertise()
{
  const auto draw = [this](const ros::SingleSubscriberPublisher&) { publishMarkers(); };
  markers_ = service_private_node_.advertise<visualization_msgs::MarkerArray>(
      "markers", 1, draw, ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);

  const auto serve = [this](const char* name, auto method, auto* object)
  { services_.push_back(service_private_node_.advertiseService(name, method, object)); };
  serve("decide", &CoordinatorRos::decide, this);
  serve("set_policy", &CoordinatorRos::setPolicy, this);
  serve("enable", &CoordinatorRos::enable, this);
  serve("nodes", &NodeSources::nodes, &node_sources_);
  serve("register_node", &NodeSources::registerNode, &node_sources_);
  serve("set_eta", &VehicleInputs::setEta, &vehicle_);
  serve("statistics", &CoordinatorRos::statistics, this);

  const auto every = [this](double period_s, void (CoordinatorRos::*function)())
  {
    timers_.push_back(service_node_.createWallTimer(
        ros::WallDuration(period_s), [this, function](const ros::WallTimerEvent&) { (this->*function)(); }));
  };
  every(options_.diagnostic_period, &CoordinatorRos::publishDiagnostics);
  every(WATCH_PERIOD_S, &CoordinatorRos::watch);
  every(1.0 / options_.marker_rate_hz, &CoordinatorRos::publishMarkers);
}

void CoordinatorRos::watch()
{
  pictures_.updateSubscription();  // roscpp does not report every subscriber that leaves
  vehicle_.watch();
  node_sources_.watch();
}

CoordinatorFigures CoordinatorRos::figures(int64_t now_ns)
{
  CoordinatorFigures figures;
  pictures_.fill(&figures);
  figures.eta = client_.eta();
  figures.enabled = client_.enabled();
  figures.jpeg_ms_per_mpixel = 1e3 * client_.encoder().jpegSecondsPerMpixel();
  figures.jpeg_bytes_per_pixel = client_.encoder().jpegBytesPerPixel();
  figures.encoding = client_.encoding();
  figures.statistics = client_.engine().statistics();
  for (size_t k = 0; k < TASK_KINDS; ++k)
  {
    const auto kind = static_cast<TaskKind>(k);
    figures.p50_s[k] = ledger_.responseTime(kind, 0.5);
    figures.p99_s[k] = ledger_.responseTime(kind, 0.99);
    figures.last_node[k] = client_.engine().lastNode(kind);
  }
  figures.nodes = client_.engine().nodes(now_ns);
  figures.links = client_.links();
  return figures;
}

void CoordinatorRos::publishMarkers()
{
  if (markers_.getNumSubscribers() == 0)
  {
    return;
  }
  const CoordinatorFigures figures = client_.call([this](int64_t now_ns) { return this->figures(now_ns); });
  markers_.publish(node_markers_.update(figures.nodes, vehicle_.vehicle(), figures.last_node, ros::Time::now()));
}

void CoordinatorRos::publishDiagnostics()
{
  CoordinatorFigures figures = client_.call(
      [this](int64_t now_ns)
      {
        pictures_.tidy(now_ns);
        return this->figures(now_ns);
      });
  pictures_.fillInput(&figures);
  vehicle_.fill(&figures);
  figures.vehicle = vehicle_name_;
  figures.policy = policy_name_;
  warnOfInput(figures);
  diagnostics_.update(figures);
}

void CoordinatorRos::warnOfInput(const CoordinatorFigures& figures)
{
  if (figures.subscribed && figures.silent_s > options_.input_timeout_s)
  {
    warnings_.warn(figures.topic + format(": nothing for %.1f s", figures.silent_s) +
                   "; check that the camera runs and that the topic is its");
  }
  if (figures.waiting > 0 && (figures.model.empty() || !figures.detector_listens))
  {
    warnings_.warn("pictures wait for the vehicle's detector, which " +
                   std::string(figures.model.empty() ? "has not said its network on local/labels"
                                                     : "does not listen to local/image") +
                   "; is pi_detect's ssd loaded and remapped?");
  }
}

}  // namespace pi_offload
