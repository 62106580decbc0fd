#include "ros/vehicle_simulator_ros.h"

#include "ros/simulation_conversions.h"

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

constexpr uint32_t IMU_QUEUE = 200;
constexpr uint32_t OBSTACLES_QUEUE = 4;
constexpr const char* CHASSIS_LINE = "chassis (on its line)";
constexpr const char* STOCK_BASE = "cmd_vel, odom";
constexpr double NO_TWIST_S = 2.0;  // by the wall: who drives a stock base may stop to, and time goes on

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
  , time_(service_node_, options_.timeOptions())
  , cameras_(service_node_, options_, calibration_)
{
  openLog();
  advertise();
  simulation_ = std::make_unique<VehicleSimulation>(scenario_, options_.simulationOptions(), outputs(), time_.nowNs());
  publishStatic();
  updater_.setHardwareID("simulated");
  updater_.add("cameras", [this](Status& status) { cameras_.report(status); });
  updater_.add("world", [this](Status& status) { reportWorld(status); });
  command_ = service_private_node_.advertiseService("command", &VehicleSimulatorRos::onCommand, this);
  command_topic_ = service_private_node_.subscribe("command", 10, &VehicleSimulatorRos::onCommandTopic, this);
  timer_ = pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { updater_.force_update(); });
  const std::string line = simulation_->chassis().path();
  ROS_INFO_STREAM_NAMED("vehicle_simulator",
                        "scenario " << scenario_.name << ", chassis at " << (line.empty() ? STOCK_BASE : line)
                                    << (line.empty() || options_.link.empty() ? "" : ", linked from " + options_.link));
  cameras_.start(simulation_->world(), scenario_.pictures(options_.rendererOptions()),
                 [this](int64_t stamp_ns) { time_.answered("rendering", "vehicle_simulator", stamp_ns); });
  simulation_thread_ = std::thread([this] { simulate(); });
  service_thread_.start();
}

VehicleSimulatorRos::~VehicleSimulatorRos()
{
  service_thread_.stop();
  time_.stop();
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
  if (options_.base == Base::TWIST)
  {
    base_odometry_ = service_node_.advertise<nav_msgs::Odometry>("odom", IMU_QUEUE);
    twist_ =
        service_node_.subscribe("cmd_vel", 1, &VehicleSimulatorRos::onTwist, this, ros::TransportHints().tcpNoDelay());
  }
  collision_ = service_node_.advertise<std_msgs::String>("collision", OBSTACLES_QUEUE);
  scenario_publisher_ = pi_node::LatchedPublisher<std_msgs::String>(service_node_, "scenario", 1);
}

void VehicleSimulatorRos::publishStatic()
{
  std_msgs::String text;
  text.data = scenario_.toJson(simulation_->mapInWorld().inverse());
  scenario_publisher_.publish(text);
}

SimulationOutputs VehicleSimulatorRos::outputs()
{
  const pi_slam::ImuSimulatorOptions imu = options_.simulationOptions().imu;
  SimulationOutputs outputs;
  outputs.imu = [this, imu](const pi_slam::ImuSample& sample)
  {
    time_.given("imu", sample.stamp_ns);
    imu_.publish(toImu(sample, imu, options_.imu_frame));
  };
  outputs.exposure = [this](const Exposure& exposure)
  {
    time_.given("rendering", exposure.stamp_ns);
    if (exposure.left == CameraState::ON)
    {
      time_.given("detection", exposure.stamp_ns);
    }
    if (exposure.left == CameraState::ON && exposure.right == CameraState::ON)
    {
      time_.given("pictures", exposure.stamp_ns);
    }
    cameras_.request(exposure);
  };
  outputs.pose = [this](const TruePose& pose)
  {
    velocity_ = pose.velocity.head<2>();
    odometry_.publish(toOdometry(pose, options_.map_frame, options_.base_link_frame));
  };
  outputs.odometry = [this](const BaseOdometry& odometry)
  { base_odometry_.publish(toOdometry(odometry, options_.odom_frame, options_.base_link_frame)); };
  outputs.obstacles = [this](int64_t stamp_ns, const std::vector<TrueObstacle>& obstacles)
  { publishObstacles(stamp_ns, obstacles); };
  outputs.collision = [this](const std::string& with)
  {
    std_msgs::String message;
    message.data = with;
    collision_.publish(message);
  };
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
  uint64_t frames = 0;
  auto commanded_at = std::chrono::steady_clock::now();
  const auto step = [this, &frames, &commanded_at]
  {
    const int64_t now_ns = time_.nowNs();
    const std::lock_guard<std::mutex> lock(simulation_mutex_);
    simulation_->advance(now_ns);
    const uint64_t counted = simulation_->chassis().received();
    const bool commanded = counted != std::exchange(frames, counted);
    commanded_at = commanded ? std::chrono::steady_clock::now() : commanded_at;
    if (!simulation_->chassis().isPlugged() || (twist_ && pi_node::secondsSince(commanded_at) > NO_TWIST_S))
    {
      time_.forget("chassis", CHASSIS_LINE);
    }
    else if (commanded)
    {
      time_.answered("chassis", CHASSIS_LINE, now_ns);
    }
  };
  while (time_.advance(step))
  {
    step();
  }
  if (const std::string problem = time_.problem(); !problem.empty())
  {
    ROS_FATAL_STREAM_NAMED("vehicle_simulator", problem);
    const std::lock_guard<std::mutex> lock(simulation_mutex_);
    simulation_->logError(problem);
    ros::requestShutdown();
  }
}

void VehicleSimulatorRos::publishObstacles(int64_t stamp_ns, const std::vector<TrueObstacle>& obstacles)
{
  if (obstacles_.getNumSubscribers() == 0)
  {
    return;
  }
  const pi_node::Footprint& o = options_.vehicle.footprint;
  const OrientedBox outline{{0.5 * (o.front - o.rear), 0.0}, 0.0, {0.5 * (o.front + o.rear), o.half_width}};
  obstacles_.publish(toObstacles(obstacles, outline, velocity_, pi_node::toTime(stamp_ns), options_.base_link_frame));
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

void VehicleSimulatorRos::onTwist(const geometry_msgs::Twist& message)
{
  bool finite = false;
  {
    const std::lock_guard<std::mutex> lock(simulation_mutex_);
    finite = simulation_->onTwist(message.linear.x, message.angular.z);
  }
  if (!finite)
  {
    warnings_.warn("a twist on " + twist_.getTopic() + " was ignored: a number is not finite");
  }
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
  const SimulatedChassis& chassis = simulation_->chassis();
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
  status.add("chassis", !chassis.isPlugged() ? "unplugged" : twist_ ? STOCK_BASE : chassis.path());
  status.add("collisions", simulation_->collisions());
  const SimulatedTime::Figures figures = time_.figures();
  status.add("simulated seconds per second", format("%.2f", figures.factor));
  status.add("waited for the vehicle [s]", format("%.1f", figures.waited_s));
  status.add("last waited for", figures.waited_for);
}

}  // namespace pi_simulation
