#include "ros/vehicle_simulator_ros.h"

#include "ros/simulation_conversions.h"

#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/ros/time.h>
#include <pthread.h>
#include <sensor_msgs/Imu.h>

#include <chrono>
#include <stdexcept>
#include <utility>
#include <vector>

namespace pi_simulation
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr auto STEP = std::chrono::microseconds(2500);
constexpr uint32_t IMU_QUEUE = 200;
constexpr uint32_t OBSTACLES_QUEUE = 4;

geometry_msgs::TransformStamped toTransform(const Eigen::Isometry3d& T_parent_child, const std::string& parent,
                                            const std::string& child)
{
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = ros::Time::now();
  transform.header.frame_id = parent;
  transform.child_frame_id = child;
  const Eigen::Quaterniond q(T_parent_child.linear());
  transform.transform.translation.x = T_parent_child.translation().x();
  transform.transform.translation.y = T_parent_child.translation().y();
  transform.transform.translation.z = T_parent_child.translation().z();
  transform.transform.rotation.w = q.w();
  transform.transform.rotation.x = q.x();
  transform.transform.rotation.y = q.y();
  transform.transform.rotation.z = q.z();
  return transform;
}

}  // namespace

VehicleSimulatorRos::VehicleSimulatorRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("simulator_ros")
  , service_node_(service_thread_.handle(node))
  , service_private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<VehicleSimulatorRosOptions>(private_node, "vehicle_simulator"))
  , calibration_(options_.calibration())
  , scenario_(Scenario::load(options_.scenario, static_cast<uint64_t>(options_.scenario_seed)))
  , warnings_(options_.warning_period_s, pi_node::warningLog<VehicleSimulatorRosOptions>("vehicle_simulator"))
  , updater_(service_node_, private_node, private_node.getNamespace())
  , cameras_(service_node_, options_, calibration_)
{
  openLog();
  advertise();
  // A clock that does not jump, which showed ROS time at the start.
  clock_offset_ns_ = pi_node::fromMsg(ros::Time::now()) - pi_node::monotonicNs();
  simulation_ = std::make_unique<VehicleSimulation>(scenario_, options_.simulationOptions(), outputs(),
                                                    [this] { return pi_node::monotonicNs() + clock_offset_ns_; });
  publishStatic();
  updater_.setHardwareID("simulated");
  updater_.add("cameras", [this](Status& status) { cameras_.report(status); });
  updater_.add("world", [this](Status& status) { reportWorld(status); });
  command_ = service_private_node_.advertiseService("command", &VehicleSimulatorRos::onCommand, this);
  command_topic_ = service_private_node_.subscribe("command", 10, &VehicleSimulatorRos::onCommandTopic, this);
  timer_ = service_node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                         [this](const ros::WallTimerEvent&) { updater_.force_update(); });
  ROS_INFO_STREAM_NAMED("vehicle_simulator", "scenario "
                                                 << scenario_.name << ", chassis at " << simulation_->chassis().path()
                                                 << (options_.link.empty() ? "" : ", linked from " + options_.link));
  cameras_.start(simulation_->world());
  simulation_thread_ = std::thread([this] { simulate(); });
  service_thread_.start();
}

VehicleSimulatorRos::~VehicleSimulatorRos()
{
  service_thread_.stop();
  stopping_ = true;
  simulation_thread_.join();
}

void VehicleSimulatorRos::openLog()
{
  if (options_.log.empty())
  {
    return;
  }
  log_.open(options_.log, std::ios::trunc);
  if (!log_)
  {
    throw std::runtime_error("parameter log = " + options_.log +
                             " cannot be written; give a file in a folder that exists");
  }
}

void VehicleSimulatorRos::advertise()
{
  imu_ = service_node_.advertise<sensor_msgs::Imu>("imu/data", IMU_QUEUE);
  odometry_ = service_node_.advertise<nav_msgs::Odometry>("ground_truth/odometry", IMU_QUEUE);
  obstacles_ = service_node_.advertise<pi_detect::ObstacleArray>("ground_truth/obstacles", OBSTACLES_QUEUE);
  scenario_publisher_ = service_node_.advertise<std_msgs::String>("scenario", 1, true);
}

void VehicleSimulatorRos::publishStatic()
{
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  T_base_body.translation() << options_.imu_in_base.x, options_.imu_in_base.y, options_.imu_in_base.z;
  broadcaster_.sendTransform(std::vector<geometry_msgs::TransformStamped>{
      toTransform(T_base_body, options_.base_link_frame, options_.imu_frame),
      toTransform(T_base_body * calibration_.left.T_body_camera, options_.base_link_frame, options_.left_frame),
      toTransform(T_base_body * calibration_.right.T_body_camera, options_.base_link_frame, options_.right_frame)});
  std_msgs::String text;
  text.data = scenario_.toJson(simulation_->mapInWorld().inverse());
  scenario_publisher_.publish(text);
}

SimulationOutputs VehicleSimulatorRos::outputs()
{
  const pi_slam::ImuSimulatorOptions imu = options_.simulationOptions().imu;
  SimulationOutputs outputs;
  outputs.imu = [this, imu](const pi_slam::ImuSample& sample) { imu_.publish(toImu(sample, imu, options_.imu_frame)); };
  outputs.exposure = [this](const Exposure& exposure) { cameras_.request(exposure); };
  outputs.pose = [this](const TruePose& pose)
  {
    velocity_ = pose.velocity.head<2>();
    odometry_.publish(toOdometry(pose, options_.map_frame, options_.base_link_frame));
  };
  outputs.obstacles = [this](int64_t stamp_ns, const std::vector<TrueObstacle>& obstacles)
  { publishObstacles(stamp_ns, obstacles); };
  if (log_.is_open())
  {
    outputs.log = [this](const std::string& line)
    {
      log_ << line << '\n' << std::flush;
      if (!log_ && !std::exchange(log_failed_, true))
      {
        ROS_ERROR_STREAM_NAMED("vehicle_simulator", options_.log << " cannot be written any more; is the disk full?");
      }
    };
  }
  return outputs;
}

void VehicleSimulatorRos::simulate()
{
  pthread_setname_np(pthread_self(), "simulation");
  auto due = std::chrono::steady_clock::now();
  while (!stopping_)
  {
    {
      const std::lock_guard<std::mutex> lock(simulation_mutex_);
      simulation_->advance(pi_node::monotonicNs() + clock_offset_ns_);
    }
    due = std::max(due + STEP, std::chrono::steady_clock::now());
    std::this_thread::sleep_until(due);
  }
}

void VehicleSimulatorRos::publishObstacles(int64_t stamp_ns, const std::vector<TrueObstacle>& obstacles)
{
  if (obstacles_.getNumSubscribers() == 0)
  {
    return;
  }
  const VehicleSimulatorRosOptions::Outline& o = options_.outline;
  const OrientedBox outline{{0.5 * (o.front - o.rear), 0.0}, 0.0, {0.5 * (o.front + o.rear), o.half_width}};
  obstacles_.publish(toObstacles(obstacles, outline, velocity_, pi_node::toTime(stamp_ns),
                                 options_.base_link_frame));
}

std::string VehicleSimulatorRos::execute(const std::string& line)
{
  std::string problem;
  {
    const std::lock_guard<std::mutex> lock(simulation_mutex_);
    problem = simulation_->command(line);
  }
  if (problem.empty())
  {
    ROS_INFO_STREAM_NAMED("vehicle_simulator", "command: " << line);
  }
  return problem;
}

bool VehicleSimulatorRos::onCommand(SimulatorCommand::Request& request, SimulatorCommand::Response& response)
{
  response.message = execute(request.line);
  response.success = response.message.empty();
  return true;
}

void VehicleSimulatorRos::onCommandTopic(const std_msgs::String& message)
{
  const std::string problem = execute(message.data);
  if (!problem.empty())
  {
    warnings_.warn(problem);
  }
}

void VehicleSimulatorRos::reportWorld(Status& status)
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  const std::lock_guard<std::mutex> lock(simulation_mutex_);
  const std::string path = simulation_->chassis().path();
  if (simulation_->collisions() > 0)
  {
    status.summary(DiagnosticStatus::WARN, std::to_string(simulation_->collisions()) + " collisions");
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, "scenario " + scenario_.name);
  }
  status.add("chassis", path.empty() ? "unplugged" : path);
  status.add("collisions", simulation_->collisions());
  status.add("time left out by pauses of this process [s]", format("%.2f", simulation_->lostSeconds()));
}

}  // namespace pi_simulation
