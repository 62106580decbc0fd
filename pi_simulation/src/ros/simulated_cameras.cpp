#include "ros/simulated_cameras.h"

#include "ros/simulation_conversions.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/time.h>
#include <pi_os_transport/zero_copy/image_subscriber.h>
#include <pthread.h>
#include <sensor_msgs/CameraInfo.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <string>
#include <utility>

namespace pi_simulation
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

namespace zero_copy = pi_os_transport::zero_copy;

namespace
{

constexpr uint32_t PICTURE_QUEUE = 4;

/// What one camera sends of an exposure.
struct StereoCamera
{
  zero_copy::Loan<sensor_msgs::Image> image;
  sensor_msgs::CameraInfo info;
  CameraState state;
  const zero_copy::Publisher<sensor_msgs::Image>* pictures;
  const ros::Publisher* infos;
};

}  // namespace

SimulatedCameras::SimulatedCameras(ros::NodeHandle node, const VehicleSimulatorRosOptions& options,
                                   const pi_slam::StereoCalibration& calibration)
  : options_(options)
  , calibration_(calibration)
  , left_(node, "left/image_raw", PICTURE_QUEUE)
  , right_(node, "right/image_raw", PICTURE_QUEUE)
  , left_info_(node.advertise<sensor_msgs::CameraInfo>("left/camera_info", PICTURE_QUEUE))
  , right_info_(node.advertise<sensor_msgs::CameraInfo>("right/camera_info", PICTURE_QUEUE))
{
}

SimulatedCameras::~SimulatedCameras()
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable())
  {
    thread_.join();
  }
}

void SimulatedCameras::start(std::shared_ptr<const SyntheticWorld> world, const StereoRendererOptions& pictures,
                             std::function<void(int64_t stamp_ns)> done)
{
  done_ = std::move(done);
  thread_ = std::thread([this, pictures, world = std::move(world)] { renderLoop(world, pictures); });
}

void SimulatedCameras::request(const Exposure& exposure)
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    skipped_ += waiting_ ? 1 : 0;
    waiting_ = exposure;
  }
  changed_.notify_all();
}

void SimulatedCameras::renderLoop(const std::shared_ptr<const SyntheticWorld>& world,
                                  const StereoRendererOptions& pictures)
{
  pthread_setname_np(pthread_self(), "rendering");
  // Applies to this thread and to those that it starts: the renderer's.
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), options_.cameras.nice);
  StereoRenderer renderer(world, calibration_, pictures);
  while (true)
  {
    Exposure exposure;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [this] { return stopping_ || waiting_; });
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
    done_(exposure.stamp_ns);
  }
}

void SimulatedCameras::render(const Exposure& exposure, StereoRenderer* renderer)
{
  const double before_s = pi_node::cpuSeconds();
  const ros::Time stamp = pi_node::toTime(exposure.stamp_ns);
  StereoFrame frame;
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
  const double baseline =
      calibration_.left.T_body_camera.translation().y() - calibration_.right.T_body_camera.translation().y();
  // Both are published together, so a subscriber waits only a little for the second one.
  StereoCamera left{makeImage(exposure.left, frame.left, calibration_.left.model, options_.left_frame),
                    toCameraInfo(calibration_.left.model, 0.0), exposure.left, &left_, &left_info_};
  StereoCamera right{makeImage(exposure.right, frame.right, calibration_.right.model, options_.right_frame),
                     toCameraInfo(calibration_.right.model, baseline), exposure.right, &right_, &right_info_};
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
  const std::lock_guard<std::mutex> lock(mutex_);
  ++pairs_;
  processor_ms_.add(1e3 * (pi_node::cpuSeconds() - before_s));
  delay_ms_.add(1e3 * (ros::Time::now() - stamp).toSec());
}

void SimulatedCameras::report(diagnostic_updater::DiagnosticStatusWrapper& status)
{
  const std::lock_guard<std::mutex> lock(mutex_);
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

}  // namespace pi_simulation
