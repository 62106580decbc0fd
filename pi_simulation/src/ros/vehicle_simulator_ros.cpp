#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_vehicle/chassis/chassis_driver.h>
#include "ros/simulation_conversions.h"
#include "ros/vehicle_simulator_ros.h"
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pthread.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <chrono>
#include <ctime>
#include <stdexcept>
#include <utility>
#include <vector>

namespace pi_simulation
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;
using CameraState;

namespace zero_copy = pi_os_transport::zero_copy;

constexpr auto STEP = std::chrono::microseconds(2500);
constexpr uint32_t IMU_QUEUE = 200;
constexpr uint32_t PICTURE_QUEUE = 4;

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

/// What one camera sends of an exposure.
struct StereoCamera
{
  zero_copy::Loan<sensor_msgs::Image> image;
  sensor_msgs::CameraInfo info;
  CameraState state;
  const zero_copy::Publisher<sensor_msgs::Image>* pictures;
  const ros::Publisher* infos;
};

double threadSeconds()
{
  timespec time = {};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
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
{
  openLog();
  advertise();
  // A clock that does not jump, which showed ROS time at the start.
  clock_offset_ns_ = static_cast<int64_t>(ros::Time::now().toNSec()) - pi_vehicle::chassis::monotonicNs();
  simulation_ = std::make_unique<VehicleSimulation>(
      scenario_, options_.simulationOptions(), outputs(), [this] { return pi_vehicle::chassis::monotonicNs() + clock_offset_ns_; });
  publishStatic();
  updater_.setHardwareID("simulated");
  updater_.add("cameras", [this](Status& status) { reportCameras(status); });
  updater_.add("world", [this](Status& status) { reportWorld(status); });
  command_ = service_private_node_.advertiseService("command", &VehicleSimulatorRos::onCommand, this);
  command_topic_ = service_private_node_.subscribe("command", 10, &VehicleSimulatorRos::onCommandTopic, this);
  timer_ = service_node_.createWallTimer(ros::WallDuration(options_.diagnostic_period),
                                         [this](const ros::WallTimerEvent&) { updater_.force_update(); });
  ROS_INFO_STREAM_NAMED("vehicle_simulator", "scenario "
                                                 << scenario_.name << ", chassis at " << simulation_->chassis().path()
                                                 << (options_.link.empty() ? "" : ", linked from " + options_.link));
  rendering_thread_ = std::thread([this] { renderLoop(); });
  simulation_thread_ = std::thread([this] { simulate(); });
  service_thread_.start();
}

VehicleSimulatorRos::~VehicleSimulatorRos()
{
  service_thread_.stop();
  {
    const std::lock_guard<std::mutex> lock(exposure_mutex_);
    stopping_ = true;
  }
  exposure_changed_.notify_all();
  simulation_thread_.join();
  rendering_thread_.join();
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
  left_ = zero_copy::Publisher<sensor_msgs::Image>(service_node_, "left/image_raw", PICTURE_QUEUE);
  right_ = zero_copy::Publisher<sensor_msgs::Image>(service_node_, "right/image_raw", PICTURE_QUEUE);
  left_info_ = service_node_.advertise<sensor_msgs::CameraInfo>("left/camera_info", PICTURE_QUEUE);
  right_info_ = service_node_.advertise<sensor_msgs::CameraInfo>("right/camera_info", PICTURE_QUEUE);
  odometry_ = service_node_.advertise<nav_msgs::Odometry>("ground_truth/odometry", IMU_QUEUE);
  obstacles_ = service_node_.advertise<pi_detect::ObstacleArray>("ground_truth/obstacles", PICTURE_QUEUE);
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
  outputs.exposure = [this](const Exposure& exposure) { request(exposure); };
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

// --------------------------------------------------------------------------------------------------------- simulation

void VehicleSimulatorRos::simulate()
{
  pthread_setname_np(pthread_self(), "simulation");
  auto due = std::chrono::steady_clock::now();
  while (!stopping_)
  {
    {
      const std::lock_guard<std::mutex> lock(simulation_mutex_);
      simulation_->advance(pi_vehicle::chassis::monotonicNs() + clock_offset_ns_);
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
  obstacles_.publish(toObstacles(obstacles, outline, velocity_, ros::Time().fromNSec(static_cast<uint64_t>(stamp_ns)),
                                 options_.base_link_frame));
}

void VehicleSimulatorRos::request(const Exposure& exposure)
{
  {
    const std::lock_guard<std::mutex> lock(exposure_mutex_);
    skipped_ += waiting_ ? 1 : 0;
    waiting_ = exposure;
  }
  exposure_changed_.notify_all();
}

// ---------------------------------------------------------------------------------------------------------- rendering

void VehicleSimulatorRos::renderLoop()
{
  pthread_setname_np(pthread_self(), "rendering");
  // Of this thread alone, and of those that it starts: the renderer's.
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), options_.cameras.nice);
  std::shared_ptr<const pi_slam::SyntheticWorld> world;
  {
    const std::lock_guard<std::mutex> lock(simulation_mutex_);
    world = simulation_->world();
  }
  pi_slam::StereoRenderer renderer(world, calibration_, options_.rendererOptions());
  while (true)
  {
    Exposure exposure;
    {
      std::unique_lock<std::mutex> lock(exposure_mutex_);
      exposure_changed_.wait(lock, [this] { return stopping_ || waiting_; });
      if (stopping_)
      {
        return;
      }
      exposure = std::move(*waiting_);
      waiting_.reset();
    }
    if (exposure.left != CameraState::OFF || exposure.right != CameraState::OFF)
    {
      render(exposure, &renderer);
    }
  }
}

void VehicleSimulatorRos::render(const Exposure& exposure, pi_slam::StereoRenderer* renderer)
{
  const double before_s = threadSeconds();
  const ros::Time stamp = ros::Time().fromNSec(static_cast<uint64_t>(exposure.stamp_ns));
  pi_slam::StereoFrame frame;
  if (exposure.left == CameraState::ON || exposure.right == CameraState::ON)
  {
    frame = renderer->render(exposure.T_world_body, exposure.stamp_ns, exposure.actors);
  }
  const int type = options_.cameras.color ? CV_8UC3 : CV_8UC1;
  const auto makeImage =
      [&](CameraState state, const cv::Mat& picture, const pi_slam::CameraModel& camera, const std::string& frame_id)
  {
    const cv::Mat black = cv::Mat::zeros(camera.height, camera.width, type);
    auto image = left_.borrow();
    toImage(state == CameraState::DARK ? black : picture, stamp, frame_id, image.get());
    return image;
  };
  // One right after the other: who takes them waits only a little for the second one.
  StereoCamera left{makeImage(exposure.left, frame.left, calibration_.left.model, options_.left_frame),
                    toCameraInfo(calibration_.left.model, 0.0), exposure.left, &left_, &left_info_};
  StereoCamera right{makeImage(exposure.right, frame.right, calibration_.right.model, options_.right_frame),
                     toCameraInfo(calibration_.right.model, options_.cameras.baseline), exposure.right, &right_,
                     &right_info_};
  for (StereoCamera* camera : {&left, &right})
  {
    if (camera->state != CameraState::OFF)
    {
      sensor_msgs::CameraInfo info = camera->info;
      info.header = zero_copy::standardHeader(camera->image->header);
      camera->infos->publish(info);
      camera->pictures->publish(std::move(camera->image));
    }
  }
  const std::lock_guard<std::mutex> lock(exposure_mutex_);
  ++pairs_;
  processor_ms_.add(1e3 * (threadSeconds() - before_s));
  delay_ms_.add(1e3 * (ros::Time::now() - stamp).toSec());
}

// ------------------------------------------------------------------------------------------------------ simulator_ros

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

void VehicleSimulatorRos::reportCameras(Status& status)
{
  const std::lock_guard<std::mutex> lock(exposure_mutex_);
  const uint64_t skipped = skipped_ - skipped_before_;
  const double rate = static_cast<double>(pairs_ - pairs_before_) / options_.diagnostic_period;
  skipped_before_ = skipped_;
  pairs_before_ = pairs_;
  if (skipped > 0)
  {
    status.summary(DiagnosticStatus::WARN, std::to_string(skipped) +
                                               " pairs skipped since the last report: rendering is too slow here; give "
                                               "cameras/threads or lower cameras/frame_rate");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, format("%.1f", rate) + " pairs per second");
  }
  status.add("pairs", pairs_);
  status.add("skipped pairs", skipped_);
  status.add("processor time per pair, of the first thread [ms]", format("%.1f", processor_ms_.mean()));
  status.add("delay of pictures p50 [ms]", format("%.1f", delay_ms_.quantile(0.5)));
  status.add("delay of pictures p99 [ms]", format("%.1f", delay_ms_.quantile(0.99)));
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
