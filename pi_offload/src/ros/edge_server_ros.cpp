#include "ros/edge_server_ros.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>

#include <algorithm>
#include <vector>

namespace pi_offload
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

}  // namespace

EdgeServerRos::EdgeServerRos(ros::NodeHandle node, ros::NodeHandle private_node, const EdgeServerRosOptions& options,
                             const EdgeServer* server, const std::string& network,
                             const pi_node::WarningBoard* warnings)
  : thread_("edge_server_ros")
  , node_(thread_.handle(node))
  , options_(options)
  , server_(server)
  , warnings_(warnings)
  , updater_(node_, private_node, private_node.getNamespace())
{
  EdgeNode announced = options_.announcement(server_->port());
  announced.network = network;
  updater_.setHardwareID(announced.id);
  updater_.add("edge server", [this](Status& status) { report(status); });
  announcement_ = pi_node::LatchedPublisher<EdgeNode>(node_, "edge_nodes", 1);
  announcement_.publish(announced);
  timer_ = node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                 [this](const ros::WallTimerEvent&) { updater_.force_update(); });
  thread_.start();
}

EdgeServerRos::~EdgeServerRos()
{
  thread_.stop();
}

void EdgeServerRos::report(Status& status)
{
  const EdgeServer::Statistics now = server_->statistics();
  const EdgeServer::Health health = server_->health();
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_->recent();
  const uint64_t refused = now.admission.refused - before_.admission.refused;
  if (!health.live)
  {
    status.summary(DiagnosticStatus::ERROR,
                   format("a worker takes longer than %.1f s for a task", options_.server.max_task_s));
  }
  else if (now.draining)
  {
    status.summary(DiagnosticStatus::WARN, "drains: takes no more tasks");
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else if (refused > 0)
  {
    status.summary(DiagnosticStatus::WARN, std::to_string(refused) + " tasks refused since the last report");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, std::to_string(now.vehicles) + " vehicles, " + std::to_string(now.running) +
                                             " of " + std::to_string(now.workers) + " workers busy, " +
                                             std::to_string(now.queued) + " tasks wait");
  }
  before_ = now;
  status.add("address", options_.announcement(server_->port()).address);
  status.add("connections", now.connections);
  status.add("vehicles", now.vehicles);
  status.add("workers", now.workers);
  status.add("tasks running", now.running);
  status.add("tasks waiting", now.queued);
  status.add("tasks taken", now.admission.taken);
  status.add("tasks refused", now.admission.refused);
  status.add("tasks expired", now.admission.expired);
  status.add("tasks cancelled", now.cancelled);
  status.add("work, sum of the workers [s]", format("%.1f", now.admission.busy_s));
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    const EdgeServer::Statistics::OfKind& of_kind = now.of_kind[kind];
    const std::string name = toString(static_cast<TaskKind>(kind));
    status.add(name + ": served", of_kind.served);
    status.add(name + ": done", of_kind.done);
    status.add(name + ": failed", of_kind.failed);
    status.add(name + ": service time [ms]", format("%.1f", 1e3 * of_kind.service_s));
  }
  status.add("probes", now.probes);
  status.add("messages that were no request", now.malformed);
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_offload
