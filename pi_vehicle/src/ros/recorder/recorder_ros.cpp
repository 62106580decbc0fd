#include "ros/recorder/recorder_ros.h"

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/vehicle_clock.h>
#include <ros/this_node.h>

#include <algorithm>
#include <set>

namespace pi_vehicle
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;
using pi_node::nanoseconds;
using recorder::DiskWriter;

constexpr double TAKE_PERIOD_S = 0.05;   // messages wait so long: waking up for each costs more than taking it
constexpr double WRITE_PERIOD_S = 0.25;  // a kill loses twice as much at most
constexpr int64_t MEGA = 1000000;
constexpr int64_t MARGIN_NS = 1000000000;  // kept beyond before_s, for a trigger that comes late

std::vector<std::string> resolved(const ros::NodeHandle& node, const std::vector<std::string>& topics)
{
  std::vector<std::string> names;
  std::transform(topics.begin(), topics.end(), std::back_inserter(names),
                 [&node](const std::string& topic) { return node.resolveName(topic); });
  return names;
}

recorder::IntakeOptions intakeOptions(const ros::NodeHandle& node, const RecorderRosOptions& options)
{
  const auto slim = resolved(node, options.slim.topics);
  const auto thinned = resolved(node, options.slim.thinned_topics);
  const auto others = resolved(node, options.topics);
  std::set<std::string> all(slim.begin(), slim.end());
  all.insert(others.begin(), others.end());
  all.erase(node.resolveName("incident"));  // which the recorder keeps itself
  recorder::IntakeOptions intake;
  intake.topics.assign(all.begin(), all.end());
  intake.pictures = resolved(node, options.pictures);
  intake.slim_topics = {slim.begin(), slim.end()};
  intake.thinned_topics = {thinned.begin(), thinned.end()};
  intake.thinned_hz = options.slim.thinned_hz;
  intake.picture_rate_hz = options.picture_rate_hz;
  intake.jpeg_quality = options.jpeg_quality;
  return intake;
}

recorder::DiskOptions diskOptions(const RecorderRosOptions& options)
{
  recorder::DiskOptions disk;
  disk.folder = options.folder;
  disk.slim_file_ns = nanoseconds(options.slim.file_s);
  disk.slim_budget = static_cast<uint64_t>(options.slim.budget_mb * MEGA);
  disk.incidents_budget = static_cast<uint64_t>(options.incidents_budget_mb * MEGA);
  disk.min_free = static_cast<uint64_t>(options.min_free_mb * MEGA);
  return disk;
}

std::string usageText(const recorder::RecordingFolder::Usage& usage, int budget_mb)
{
  return std::to_string(usage.files) + " files, " + format("%.1f", static_cast<double>(usage.bytes) / MEGA) + " of " +
         std::to_string(budget_mb) + " MB";
}

}  // namespace

RecorderRos::RecorderRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : thread_("recorder")
  , disk_thread_("recorder_disk")
  , node_(thread_.handle(node))
  , disk_node_(disk_thread_.handle(node))
  , private_node_(thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<RecorderRosOptions>(private_node, "recorder"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<RecorderRosOptions>("recorder"))
  , updater_(node_, private_node, private_node.getNamespace())
  , memory_(static_cast<size_t>(options_.memory_mb * MEGA), nanoseconds(options_.before_s) + MARGIN_NS)
  , plan_({nanoseconds(options_.before_s), nanoseconds(options_.after_s), nanoseconds(options_.longest_s)})
  , disk_(diskOptions(options_), &memory_, &plan_,
          [this](DiskWriter::Level level, const std::string& text)
          {
            if (level == DiskWriter::Level::INFO)
            {
              ROS_INFO_STREAM_NAMED("recorder", text);
            }
            else if (level == DiskWriter::Level::WARN)
            {
              warnings_.warn(text);
            }
            else
            {
              ROS_ERROR_STREAM_NAMED("recorder", text);
            }
          })
  , triggers_(options_.braking_deceleration, options_.take_over_sources)
  , intake_(node, intakeOptions(node, options_), &memory_, &warnings_)
{
  incident_ = pi_node::LatchedPublisher<Incident>(node_, "incident", 10);
  updater_.setHardwareID("none");
  updater_.add("recorder", [this](Status& status) { report(status); });
  subscribeTriggers();
  save_ = private_node_.advertiseService("save", &RecorderRos::onSave, this);
  timer_ = pi_node::VehicleTimer(node_, TAKE_PERIOD_S, [this] { tick(); });
  disk_timer_ = pi_node::VehicleTimer(disk_node_, WRITE_PERIOD_S, [this] { disk_.tick(); });
  diagnostic_timer_ = pi_node::VehicleTimer(node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  thread_.start();
  disk_thread_.start();
}

RecorderRos::~RecorderRos()
{
  thread_.stop();
  disk_thread_.stop();
  tick();
  disk_.finish();
}

void RecorderRos::subscribeTriggers()
{
  ros::NodeHandle node = intake_.node();
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  const auto act = [this](const std::optional<recorder::Trigger>& found)
  {
    if (found)
    {
      trigger(*found);
    }
  };
  constexpr uint32_t queue = 100;
  subscribers_.push_back(node.subscribe<ArbiterState>(
      "arbiter/state", queue, [this, act](const ArbiterState::ConstPtr& state) { act(triggers_.onArbiter(*state)); },
      ros::VoidConstPtr(), hints));
  subscribers_.push_back(node.subscribe<VehicleState>(
      "vehicle_state", queue, [this, act](const VehicleState::ConstPtr& state) { act(triggers_.onVehicle(*state)); },
      ros::VoidConstPtr(), hints));
  subscribers_.push_back(node.subscribe<MotionCommand>(
      "motion", queue,
      [this, act](const MotionCommand::ConstPtr& command) { act(triggers_.onMotion(*command, elapsedNow())); },
      ros::VoidConstPtr(), hints));
  subscribers_.push_back(node.subscribe<topic_tools::ShapeShifter>(
      options_.collision_topic, queue,
      [this, act](const topic_tools::ShapeShifter::ConstPtr& message) { act(triggers_.onCollision(*message)); },
      ros::VoidConstPtr(), hints));
}

bool RecorderRos::onSave(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  const std::string file = trigger({"request", "asked by service save"});
  const std::string problem = disk_.state().problem;
  response.success = problem.empty();
  response.message = problem.empty() ? file : file + " will be written once there is room: " + problem;
  return true;
}

void RecorderRos::tick()
{
  intake_.take(elapsedNow());
}

/// The vehicle's clock without its jumps back.
int64_t RecorderRos::elapsedNow()
{
  const int64_t now_ns = pi_node::vehicleNs();
  if (now_ns < vehicle_ns_)
  {
    warnings_.warn("the clock went back by " + format("%.1f s", pi_node::secondsBetween(now_ns, vehicle_ns_)) +
                   "; files end here and others begin");
    jumped_ns_ += vehicle_ns_ - now_ns + 1;  // after all that came before
    plan_.cut(now_ns + jumped_ns_);
  }
  vehicle_ns_ = now_ns;
  return now_ns + jumped_ns_;
}

std::string RecorderRos::trigger(const recorder::Trigger& trigger)
{
  const int64_t elapsed_ns = elapsedNow();
  const ros::Time now = ros::Time::now();
  last_.header.stamp = now;
  last_.cause = trigger.cause;
  last_.text = trigger.text;
  // The message names its file, and the plan needs the message: what the file will be is asked for first.
  const std::string fresh = disk_.incidentName(static_cast<int64_t>(now.toNSec()), trigger.cause);
  const std::string name = plan_.nameFor(elapsed_ns).value_or(fresh);
  last_.file = disk_.incidentPath(name);
  const recorder::KeptMessagePtr message =
      intake_.keep(node_.resolveName("incident"), last_, now, elapsed_ns, ros::this_node::getName(), true);
  plan_.trigger(message, name);
  incident_.publish(last_);
  ROS_WARN_STREAM_NAMED("recorder",
                        "incident: " << trigger.cause << ", " << trigger.text << "; goes to " << last_.file);
  return last_.file;
}

void RecorderRos::report(Status& status) const
{
  const DiskWriter::State disk = disk_.state();
  const recorder::MessageMemory::Usage memory = memory_.usage();
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  const bool short_of_bytes =
      memory.forgot_ns >= 0 && memory_.completeNs() - memory.forgot_ns < nanoseconds(options_.before_s);
  if (!disk.problem.empty())
  {
    status.summary(DiagnosticStatus::ERROR, disk.problem);
  }
  else if (short_of_bytes)
  {
    status.summary(DiagnosticStatus::WARN, format("memory_mb is enough for %.0f of ", memory.seconds) +
                                               format("%.0f s", options_.before_s) +
                                               "; raise it, or lower picture_rate_hz");
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, disk.incident.empty() ? "records" : "records " + disk.incident);
  }
  status.add("memory [MB]", format("%.1f of %.0f", static_cast<double>(memory.bytes) / MEGA, options_.memory_mb));
  status.add("memory [s]", format("%.1f", memory.seconds));
  status.add("messages in memory", memory.messages);
  status.add("messages forgotten early", memory.forgotten);
  status.add("messages not written", disk.missed);
  status.add("slim file", disk.slim);
  status.add("slim", usageText(disk.slim_usage, options_.slim.budget_mb));
  status.add("incidents", usageText(disk.incidents_usage, options_.incidents_budget_mb));
  status.add("incidents since the start", disk.incidents);
  status.add("last incident", last_.cause.empty() ? "none" : last_.cause + ": " + last_.file);
  status.add("free on the disk [MB]", format("%.0f", static_cast<double>(disk.free_bytes) / MEGA));
  std::string silent;
  for (const std::string& topic : intake_.silent())
  {
    silent += (silent.empty() ? "" : ", ") + topic;
  }
  status.add("nothing came yet of", silent.empty() ? "none" : silent);
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_vehicle
