#include "drive_on_graph.h"

#include "drives/vehicle_path.h"
#include "front_end/frame_features.h"
#include "ros/conversions.h"

#include <algorithm>
#include <cmath>
#include <thread>
#include <utility>

namespace pi_slam
{
using namespace pi_simulation;
namespace
{

constexpr int WIDTH_PX = 320;
constexpr int HEIGHT_PX = 240;
constexpr double BASELINE_M = 0.12;
constexpr double FRAME_RATE_HZ = 15.0;
const char* const FRAMES[2] = {"left_optical", "right_optical"};

/// Pictures leave the camera later than samples of the same time leave the IMU [s].
constexpr double PICTURE_DELAY_S = 0.01;

}  // namespace

SyntheticDrive SyntheticDrive::make(double duration_s)
{
  VehiclePathOptions path;
  path.shape = PathShape::STRAIGHT;
  path.duration_s = duration_s + 1.0;
  path.speed = 1.5;
  path.start_standstill_s = 0.8;
  const std::vector<StampedPose> poses = makeVehiclePath(path);
  SyntheticWorldOptions world;
  world.kind = WorldKind::HALL;
  world.crossing = false;
  const SplineTrajectory trajectory = SplineTrajectory::fit(poses);

  SyntheticDrive drive;
  drive.calibration = StereoCalibration::makeForwardPair(WIDTH_PX, HEIGHT_PX, BASELINE_M);
  const int64_t start_ns = trajectory.startNs();
  const int64_t end_ns = start_ns + std::llround(1e9 * duration_s);
  drive.imu = ImuSimulator(ImuSimulatorOptions()).simulate(trajectory, start_ns, end_ns);
  for (const ImuSample& sample : drive.imu)
  {
    drive.T_world_body.push_back(trajectory.at(sample.stamp_ns).T_world_body);
  }
  StereoRendererOptions options;
  options.threads = 2;
  options.supersampling = Supersampling::NONE;
  StereoRenderer renderer(SyntheticWorld::build(world, poses), drive.calibration, options);
  for (int i = 0; i / FRAME_RATE_HZ < duration_s; ++i)
  {
    drive.frames.push_back(renderer.render(trajectory, start_ns + std::llround(1e9 * i / FRAME_RATE_HZ)));
  }
  return drive;
}

Eigen::Isometry3d DriveOnGraph::T_base_body()
{
  Eigen::Isometry3d T_base_body = Eigen::Isometry3d::Identity();
  T_base_body.translation() << 0.2, 0.1, 0.3;
  return T_base_body;
}

DriveOnGraph::DriveOnGraph(SyntheticDrive drive) : drive_(std::move(drive))
{
  imu_ = node_.advertise<sensor_msgs::Imu>("imu/data", 1000);
  for (const int camera : {LEFT, RIGHT})
  {
    const std::string side = camera == LEFT ? "left" : "right";
    images_[camera] = node_.advertise<sensor_msgs::Image>(side + "/image_raw", 10);
    infos_[camera] = node_.advertise<sensor_msgs::CameraInfo>(side + "/camera_info", 10);
  }
  const ros::Time stamp = toTime(drive_.imu.front().stamp_ns);
  tf_static_.sendTransform(std::vector<geometry_msgs::TransformStamped>{
      toTransform(T_base_body(), stamp, "base_link", "imu_link"),
      toTransform(drive_.calibration.left.T_body_camera, stamp, "imu_link", FRAMES[LEFT])});
}

bool DriveOnGraph::waitForListeners(double timeout_s)
{
  return until(timeout_s,
               [this]
               {
                 return imu_.getNumSubscribers() > 0 && images_[LEFT].getNumSubscribers() > 0 &&
                        images_[RIGHT].getNumSubscribers() > 0 && infos_[LEFT].getNumSubscribers() > 0 &&
                        infos_[RIGHT].getNumSubscribers() > 0;
               });
}

bool DriveOnGraph::waitForNoListeners(double timeout_s)
{
  return until(timeout_s, [this] { return imu_.getNumSubscribers() == 0 && images_[LEFT].getNumSubscribers() == 0; });
}

sensor_msgs::CameraInfo DriveOnGraph::info(int camera) const
{
  const CameraModel& model = drive_.calibration.left.model;
  sensor_msgs::CameraInfo info;
  info.header.frame_id = FRAMES[camera];
  info.width = static_cast<uint32_t>(model.width);
  info.height = static_cast<uint32_t>(model.height);
  info.distortion_model = "plumb_bob";
  info.D.assign(5, 0.0);
  info.K = {model.fx, 0.0, model.cx, 0.0, model.fy, model.cy, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {model.fx, 0.0, model.cx, 0.0, 0.0, model.fy, model.cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  info.P[3] = camera == LEFT ? 0.0 : -model.fx * BASELINE_M;
  return info;
}

void DriveOnGraph::play(double from_s, double to_s, double speed, double later_s, const Faults& faults)
{
  using Clock = std::chrono::steady_clock;
  const int64_t start_ns = drive_.imu.front().stamp_ns;
  const int64_t later_ns = std::llround(1e9 * later_s);
  struct Item
  {
    double due_s;
    size_t index;
    bool picture;
  };
  std::vector<Item> items;
  for (size_t i = 0; i < drive_.imu.size(); ++i)
  {
    items.push_back({1e-9 * static_cast<double>(drive_.imu[i].stamp_ns - start_ns), i, false});
  }
  for (size_t i = 0; i < drive_.frames.size(); ++i)
  {
    items.push_back({1e-9 * static_cast<double>(drive_.frames[i].stamp_ns - start_ns) + PICTURE_DELAY_S, i, true});
  }
  std::sort(items.begin(), items.end(), [](const Item& a, const Item& b) { return a.due_s < b.due_s; });
  const Clock::time_point begin = Clock::now();
  for (const Item& item : items)
  {
    if (item.due_s < from_s || item.due_s >= to_s)
    {
      continue;
    }
    std::this_thread::sleep_until(begin + std::chrono::duration_cast<Clock::duration>(
                                              std::chrono::duration<double>((item.due_s - from_s) / speed)));
    if (!item.picture)
    {
      const ImuSample& sample = drive_.imu[item.index];
      sensor_msgs::Imu imu;
      imu.header.stamp = toTime(sample.stamp_ns + later_ns);
      imu.header.frame_id = "imu_link";
      imu.orientation_covariance[0] = -1.0;
      imu.angular_velocity.x = sample.w.x();
      imu.angular_velocity.y = sample.w.y();
      imu.angular_velocity.z = sample.w.z();
      imu.linear_acceleration.x = sample.f.x();
      imu.linear_acceleration.y = sample.f.y();
      imu.linear_acceleration.z = sample.f.z();
      if (!faults.imu || faults.imu(&imu))
      {
        imu_.publish(imu);
      }
      continue;
    }
    const StereoFrame& frame = drive_.frames[item.index];
    const ros::Time stamp = toTime(frame.stamp_ns + later_ns);
    for (const int camera : {LEFT, RIGHT})
    {
      sensor_msgs::CameraInfo camera_info = info(camera);
      camera_info.header.stamp = stamp;
      if (faults.info)
      {
        faults.info(camera, &camera_info);
      }
      infos_[camera].publish(camera_info);
      const sensor_msgs::ImagePtr image = toImage(camera == LEFT ? frame.left : frame.right, stamp, FRAMES[camera]);
      if (!faults.image || faults.image(camera, image.get()))
      {
        images_[camera].publish(image);
      }
    }
  }
}

bool DriveOnGraph::playUntil(double from_s, double speed, double later_s, const std::function<bool()>& condition,
                             const Faults& faults)
{
  constexpr double STEP_S = 0.2;
  const double end_s = 1e-9 * static_cast<double>(drive_.imu.back().stamp_ns - drive_.imu.front().stamp_ns);
  for (double now_s = from_s; now_s < end_s; now_s += STEP_S)
  {
    play(now_s, now_s + STEP_S, speed, later_s, faults);
    if (condition())
    {
      return true;
    }
  }
  return false;
}

}  // namespace pi_slam
