#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_runtime/runtime.h>
#include "ros/conversions.h"
#include "ros/vio_ros.h"
#include <pthread.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <exception>
#include <stdexcept>

namespace pi_slam
{
namespace
{

using pi_node::format;
using pi_node::seconds;
using pi_node::sizeText;

namespace zero_copy = pi_os_transport::zero_copy;

constexpr double TICK_S = 0.1;
constexpr size_t EARLIER_FRAMES = 5;  ///< whose tracks are drawn
/// Pairs in a row with texture but hardly a feature seen by both cameras, after which there is a warning.
constexpr int MAX_PAIRS_WITHOUT_STEREO = 20;
constexpr int MIN_STEREO_FEATURES = 5;
constexpr int64_t HISTORY_NS = 5000000000;  ///< of odometry, for poses that are said later
constexpr int64_t HISTORY_SPACING_NS = 4000000;

int64_t nanoseconds(double s)
{
  return std::llround(1e9 * s);
}

/// All that the calibration depends on; a stamp is no change.
bool sameCamera(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b)
{
  return a.width == b.width && a.height == b.height && a.distortion_model == b.distortion_model && a.D == b.D &&
         a.K == b.K && a.R == b.R && a.P == b.P && a.binning_x == b.binning_x && a.binning_y == b.binning_y &&
         a.roi.x_offset == b.roi.x_offset && a.roi.y_offset == b.roi.y_offset && a.roi.width == b.roi.width &&
         a.roi.height == b.roi.height && a.header.frame_id == b.header.frame_id;
}

}  // namespace

void VioRos::Input::note()
{
  ++messages;
  came_at = Clock::now().time_since_epoch().count();
}

double VioRos::Input::silentSeconds() const
{
  return std::chrono::duration<double>(Clock::now().time_since_epoch() - Clock::duration(came_at)).count();
}

VioRos::VioRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : imu_thread_("vio_imu")
  , input_thread_("vio_input")
  , output_thread_("vio_output")
  , service_thread_("vio_service")
  , imu_node_(imu_thread_.handle(node))
  , input_node_(input_thread_.handle(node))
  , output_node_(output_thread_.handle(node))
  , private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<VioRosOptions>(private_node, "vio"))
  , runtime_(options_.vio.tracker.use_runtime || options_.mapper.use_runtime ? pi_runtime::Runtime::shared() : nullptr)
  , warnings_(options_.warning_period_s, pi_node::warningLog<VioRosOptions>("vio"))
  , diagnostics_(output_node_, private_node, &warnings_, options_.input_timeout_s)
  , matcher_(options_.pair_tolerance_s, options_.pair_wait_s)
  , odom_history_(HISTORY_NS, HISTORY_SPACING_NS)
{
  if (options_.calibration.source != CalibrationSource::CAMERA_INFO)
  {
    file_calibration_ = loadCalibrationFiles(options_.calibration, options_.vio.imu);
    checkStereo(file_calibration_->cameras, std::string("calibration/") + toString(options_.calibration.source));
  }

  const auto queue_size = static_cast<uint32_t>(options_.queue_size);
  odometry_ = output_node_.advertise<nav_msgs::Odometry>("odometry", static_cast<uint32_t>(options_.imu_queue_size));
  map_pose_ = output_node_.advertise<geometry_msgs::PoseWithCovarianceStamped>("map_pose", 5);
  path_ = output_node_.advertise<nav_msgs::Path>("path", 1);
  points_ = output_node_.advertise<sensor_msgs::PointCloud2>("points", 1);
  tracks_ = private_node_.advertise<sensor_msgs::Image>("debug/tracks", 2);

  const auto hints = ros::TransportHints().tcpNoDelay();
  imu_input_.topic = imu_node_.resolveName("imu/data");
  imu_input_.came_at = Clock::now().time_since_epoch().count();
  subscribers_.push_back(
      imu_node_.subscribe("imu/data", static_cast<uint32_t>(options_.imu_queue_size), &VioRos::onImu, this, hints));
  for (const int camera : {LEFT, RIGHT})
  {
    const std::string side = camera == LEFT ? "left" : "right";
    picture_inputs_[camera].topic = input_node_.resolveName(side + "/image_raw");
    picture_inputs_[camera].came_at = Clock::now().time_since_epoch().count();
    subscribers_.push_back(zero_copy::subscribeImages(
        input_node_, side + "/image_raw", queue_size, options_.zero_copy,
        [this, camera](const zero_copy::ImageHandle& message) { onImage(camera, message); }, hints));
    info_inputs_[camera].topic = input_node_.resolveName(side + "/camera_info");
    info_inputs_[camera].came_at = Clock::now().time_since_epoch().count();
    if (!file_calibration_)
    {
      subscribers_.push_back(input_node_.subscribe<sensor_msgs::CameraInfo>(
          side + "/camera_info", queue_size,
          [this, camera](const sensor_msgs::CameraInfoConstPtr& info) { onCameraInfo(camera, info); },
          ros::VoidConstPtr(), hints));
    }
  }
  services_.push_back(private_node_.advertiseService("save_map", &VioRos::saveMap, this));
  services_.push_back(private_node_.advertiseService("load_map", &VioRos::loadMap, this));
  services_.push_back(private_node_.advertiseService("reset", &VioRos::reset, this));
  subscribers_.push_back(service_thread_.handle(node).subscribe("initialpose", 1, &VioRos::onInitialPose, this));

  const auto repeat = [this](double period_s, void (VioRos::*function)())
  {
    timers_.push_back(output_node_.createWallTimer(
        ros::WallDuration(period_s), [this, function](const ros::WallTimerEvent&) { (this->*function)(); }));
  };
  repeat(TICK_S, &VioRos::tick);
  repeat(options_.path_period_s, &VioRos::publishPath);
  repeat(options_.points_period_s, &VioRos::publishPoints);
  repeat(options_.diagnostic_period, &VioRos::publishDiagnostics);

  prepare();  // with everything from files there is nothing to wait for
  worker_ = std::thread([this] { work(); });
  imu_thread_.start();
  input_thread_.start();
  output_thread_.start();
  service_thread_.start();
}

VioRos::~VioRos()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  pairs_changed_.notify_all();
  imu_arrived_.notify_all();
  imu_thread_.stop();
  input_thread_.stop();
  output_thread_.stop();
  service_thread_.stop();
  worker_.join();
  subscribers_.clear();
  services_.clear();
  timers_.clear();
}

// ------------------------------------------------------------------------------------------------------------ vio_imu

void VioRos::onImu(const sensor_msgs::ImuConstPtr& message)
{
  const Clock::time_point begin = Clock::now();
  imu_input_.note();
  ImuSample sample;
  try
  {
    sample = fromMsg(*message);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(imu_input_.topic + ": " + error.what());
    return;
  }
  if (sample.stamp_ns == 0)
  {
    warnings_.error(imu_input_.topic + ": stamp is 0, sample ignored; the driver must stamp its messages");
    return;
  }
  const int64_t last_ns = last_imu_ns_;
  if (last_ns - sample.stamp_ns > nanoseconds(options_.time_jump_s))
  {
    restart(imu_input_.topic + ": time went back by " + format("%.3f", seconds(last_ns - sample.stamp_ns)) +
                " s (a recording that began anew?): odometry begins anew",
            false);
    last_imu_ns_ = sample.stamp_ns;
  }
  else if (sample.stamp_ns > last_ns)
  {
    last_imu_ns_ = sample.stamp_ns;
  }

  PipelinePtr pipeline;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    pipeline = pipeline_;
    if (imu_frame_ != message->header.frame_id)
    {
      imu_frame_ = message->header.frame_id;
    }
  }
  if (!pipeline)
  {
    return;
  }
  const std::optional<PropagatedState> propagated = pipeline->vio->addImu(sample);
  if (worker_waits_for_imu_)
  {
    // The lock makes sure that the worker is not between its look and its sleep.
    std::unique_lock<std::mutex>(mutex_).unlock();
    imu_arrived_.notify_all();
  }
  const std::string warning = pipeline->vio->imuMessage();
  if (!warning.empty())
  {
    warnings_.warn(warning);
  }
  if (propagated)
  {
    publishOdometry(*pipeline, *propagated);
    diagnostics_.addImu(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
  }
}

void VioRos::publishOdometry(const Pipeline& pipeline, const PropagatedState& propagated)
{
  const auto odometry = boost::make_shared<nav_msgs::Odometry>(toOdometry(
      propagated, pipeline.T_base_body, pipeline.gyro_variance, options_.odom_frame, options_.base_link_frame));
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (pipeline_.get() == &pipeline)
    {
      odom_history_.add(propagated.state.stamp_ns, fromMsg(odometry->pose.pose));
    }
  }
  odometry_.publish(odometry);
  ++odometries_;
  const int64_t stamp_ns = propagated.state.stamp_ns;
  last_odometry_ns_ = stamp_ns;

  const int64_t period_ns = options_.tf_rate_hz > 0.0 ? nanoseconds(1.0 / options_.tf_rate_hz) : 0;
  const bool jumped = std::abs(stamp_ns - next_tf_ns_) > 2 * period_ns;
  if (stamp_ns < next_tf_ns_ && !jumped)
  {
    return;
  }
  next_tf_ns_ = (jumped ? stamp_ns : next_tf_ns_) + period_ns;
  std::vector<geometry_msgs::TransformStamped> transforms;
  if (options_.publish_tf)
  {
    transforms.push_back(toTransform(fromMsg(odometry->pose.pose), odometry->header.stamp, options_.odom_frame,
                                     options_.base_link_frame));
  }
  Eigen::Isometry3d T_map_odom;
  std::optional<Eigen::Matrix4d> map_covariance;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    T_map_odom = T_map_odom_;
    map_covariance = map_covariance_;
  }
  if (map_covariance && map_pose_.getNumSubscribers() > 0)
  {
    map_pose_.publish(toMapPose(*odometry, T_map_odom, *map_covariance, pipeline.T_base_body, options_.map_frame));
  }
  if (options_.publish_map_tf)
  {
    transforms.push_back(toTransform(T_map_odom, odometry->header.stamp, options_.map_frame, options_.odom_frame));
  }
  if (!transforms.empty())
  {
    tf_broadcaster_.sendTransform(transforms);
  }
}

// ---------------------------------------------------------------------------------------------------------- vio_input

void VioRos::onCameraInfo(int camera, const sensor_msgs::CameraInfoConstPtr& info)
{
  info_inputs_[camera].note();
  std::lock_guard<std::mutex> lock(mutex_);
  if (!infos_[camera] || !sameCamera(*infos_[camera], *info))
  {
    infos_[camera] = info;
    infos_changed_ = true;
  }
}

void VioRos::onImage(int camera, const zero_copy::ImageHandle& message)
{
  const std::string& topic = picture_inputs_[camera].topic;
  picture_inputs_[camera].note();
  const int64_t stamp_ns = fromMsg(message->header.stamp);
  if (stamp_ns == 0)
  {
    warnings_.error(topic + ": stamp is 0, picture ignored; the driver must stamp its messages");
    return;
  }
  const int64_t jump_ns = nanoseconds(options_.time_jump_s);
  const int64_t last_ns = last_picture_ns_[camera];
  if (last_ns - stamp_ns > jump_ns)
  {
    if (last_ns - last_imu_ns_ > jump_ns)
    {
      // The IMU has gone back before, and odometry with it.
      std::lock_guard<std::mutex> lock(mutex_);
      matcher_.clear();
      pairs_.clear();
    }
    else
    {
      restart(topic + ": time went back by " + format("%.3f", seconds(last_ns - stamp_ns)) +
                  " s (a recording that began anew?): odometry begins anew",
              false);
    }
    last_picture_ns_[LEFT] = last_picture_ns_[RIGHT] = stamp_ns;
  }
  else if (stamp_ns > last_ns)
  {
    last_picture_ns_[camera] = stamp_ns;
  }

  const PipelinePtr pipeline = this->pipeline();
  if (!pipeline)
  {
    return;
  }
  cv::Mat picture;
  try
  {
    picture = fromMsg(message);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(topic + ": " + error.what() + "; picture ignored");
    return;
  }
  const CameraModel& model = (camera == LEFT ? pipeline->cameras.left : pipeline->cameras.right).model;
  if (picture.cols != model.width || picture.rows != model.height)
  {
    const std::string source = file_calibration_ ? std::string("calibration/") + toString(options_.calibration.source)
                                                 : info_inputs_[camera].topic;
    warnings_.error(topic + ": picture is " + sizeText(picture.cols, picture.rows) + ", but " + source + " is for " +
                    sizeText(model.width, model.height) + "; picture ignored until they agree");
    return;
  }
  std::vector<PicturePair> pairs;
  std::optional<double> mismatch_s;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (pipeline_ != pipeline)
    {
      return;
    }
    if (camera == LEFT && left_frame_ != message->header.frame_id)
    {
      left_frame_ = message->header.frame_id;
    }
    matcher_.add(camera, stamp_ns, picture, &pairs);
    mismatch_s = matcher_.takeMismatch();
    enqueue(&pairs);
  }
  pairs_changed_.notify_one();
  if (mismatch_s)
  {
    warnings_.warn(picture_inputs_[LEFT].topic + " and " + picture_inputs_[RIGHT].topic + ": stamps differ by " +
                   format("%.4f", *mismatch_s) +
                   " s, above pair_tolerance_s = " + format("%.4f", options_.pair_tolerance_s) +
                   "; trigger the cameras together, or raise the tolerance");
  }
}

void VioRos::enqueue(std::vector<PicturePair>* pairs)
{
  for (PicturePair& pair : *pairs)
  {
    delay_ns_ = last_imu_ns_ - pair.stamp_ns;
    pairs_.push_back(std::move(pair));
  }
  while (pairs_.size() > static_cast<size_t>(options_.queue_size))
  {
    pairs_.pop_front();
    ++dropped_pairs_;
  }
}

// --------------------------------------------------------------------------------------------------------- vio_worker

void VioRos::work()
{
  pthread_setname_np(pthread_self(), "vio_worker");
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stopping_)
  {
    pairs_changed_.wait(lock, [this] { return stopping_ || !pairs_.empty(); });
    if (stopping_)
    {
      return;
    }
    const PicturePair pair = std::move(pairs_.front());
    pairs_.pop_front();
    PipelinePtr pipeline = pipeline_;
    const uint64_t generation = generation_;
    if (!pipeline)
    {
      continue;
    }
    worker_waits_for_imu_ = true;
    const auto done = [&] { return stopping_ || generation_ != generation || pipeline->vio->imuCovers(pair.stamp_ns); };
    const bool covered = imu_arrived_.wait_for(lock, std::chrono::duration<double>(options_.imu_wait_s), done);
    worker_waits_for_imu_ = false;
    if (stopping_ || generation_ != generation)
    {
      continue;
    }
    lock.unlock();
    if (!covered)
    {
      const int64_t last_imu_ns = last_imu_ns_;
      warnings_.warn(imu_input_.topic + ": waited " + format("%.2f", options_.imu_wait_s) +
                     " s for it to reach the stamp of a pair, " +
                     (last_imu_ns == 0
                          ? std::string("no sample came")
                          : "its newest is " + format("%.3f", seconds(pair.stamp_ns - last_imu_ns)) + " s before") +
                     "; check that the IMU runs, with the cameras' clock");
    }
    try
    {
      workOn(pair, *pipeline, generation);
    }
    catch (const std::exception& error)
    {
      warnings_.error(std::string("a pair cannot be used: ") + error.what());
    }
    pipeline.reset();  // may be the last to hold an old one, whose end takes time
    lock.lock();
  }
}

void VioRos::workOn(const PicturePair& pair, const Pipeline& pipeline, uint64_t generation)
{
  if (worked_generation_ != generation)
  {
    worked_generation_ = generation;
    status_ = VioStatus::INITIALIZING;
    started_ = false;
    pairs_without_stereo_ = 0;
    earlier_.clear();
    // Here, where frames for the map come from: none of the old time can follow.
    if (pipeline.mapper && pipeline.mapper == worked_mapper_.lock())
    {
      pipeline.mapper->odometryReset();
    }
    worked_mapper_ = pipeline.mapper;
  }
  const FrameReport report = pipeline.vio->addPair(pair.stamp_ns, pair.left, pair.right);
  diagnostics_.addFrame(report);
  warnOf(report, pair);

  if (pipeline.mapper)
  {
    if (report.reset && started_)
    {
      pipeline.mapper->odometryReset();
    }
    std::lock_guard<std::mutex> lock(mutex_);
    if (generation_ == generation)
    {
      T_map_odom_ = pipeline.mapper->T_map_odom();
      const MapStatistics map = pipeline.mapper->statistics();
      map_covariance_ = map.localized ? std::optional(map.covariance) : std::nullopt;
    }
  }
  if (report.status != VioStatus::INITIALIZING && report.status != VioStatus::LOST)
  {
    started_ = true;
    keepForPath(pipeline);
  }
  showTracks(pair, pipeline);
}

void VioRos::warnOf(const FrameReport& report, const PicturePair& pair)
{
  if (!report.message.empty())
  {
    warnings_.warn(report.message);
  }
  for (const int camera : {LEFT, RIGHT})
  {
    if ((camera == LEFT ? pair.left : pair.right).empty())
    {
      warnings_.warn(picture_inputs_[camera].topic +
                     ": no picture beside that of the other camera within pair_wait_s; "
                     "odometry goes on with one camera");
    }
  }
  const double delay_s = seconds(delay_ns_);
  if (delay_s > options_.max_delay_s)
  {
    warnings_.warn("pictures come " + format("%.3f", delay_s) + " s after IMU samples of the same stamp, above " +
                   "max_delay_s = " + format("%.3f", options_.max_delay_s) +
                   "; check exposure, transport and clocks: odometry rests on the IMU for so long");
  }
  // Swapped cameras see nothing in common, however good the pictures.
  const TrackerReport& tracker = report.tracker;
  const bool usable =
      report.processed && !pair.left.empty() && !pair.right.empty() && !tracker.blank[LEFT] && !tracker.blank[RIGHT];
  if (usable)
  {
    pairs_without_stereo_ = tracker.stereo < MIN_STEREO_FEATURES ? pairs_without_stereo_ + 1 : 0;
  }
  if (usable && pairs_without_stereo_ >= MAX_PAIRS_WITHOUT_STEREO)
  {
    warnings_.warn("left and right have texture, but hardly a feature in common (" + std::to_string(tracker.stereo) +
                   " of " + std::to_string(report.features) +
                   "): the cameras are swapped or not triggered together, or the calibration is another pair's");
  }
  if (report.status != status_)
  {
    const std::string text = std::string("odometry: ") + toString(status_) + " -> " + toString(report.status);
    if (report.status == VioStatus::LOST || report.status == VioStatus::BLIND)
    {
      warnings_.warn(text);
    }
    else if (report.status == VioStatus::STANDSTILL || status_ == VioStatus::STANDSTILL)
    {
      ROS_DEBUG_STREAM_NAMED("vio", text);
    }
    else
    {
      ROS_INFO_STREAM_NAMED("vio", text << " with " << report.features << " features");
    }
    status_ = report.status;
  }
}

void VioRos::keepForPath(const Pipeline& pipeline)
{
  const std::optional<PropagatedState> corrected = pipeline.vio->newestCorrected();
  if (!corrected)
  {
    return;
  }
  const Eigen::Isometry3d T_odom_body = corrected->state.T_odom_body();
  std::lock_guard<std::mutex> lock(mutex_);
  if (generation_ != worked_generation_ ||
      (!odom_path_.empty() &&
       (odom_path_.back().second.translation() - T_odom_body.translation()).norm() < options_.path_spacing_m))
  {
    return;
  }
  odom_path_.emplace_back(corrected->state.stamp_ns, T_odom_body);
  if (odom_path_.size() > static_cast<size_t>(options_.path_length))
  {
    odom_path_.pop_front();
  }
}

void VioRos::showTracks(const PicturePair& pair, const Pipeline& pipeline)
{
  if (tracks_.getNumSubscribers() == 0)
  {
    earlier_.clear();
    return;
  }
  Tracks tracks;
  tracks.pair = pair;
  tracks.features = pipeline.vio->newestFeatures();
  tracks.earlier.assign(earlier_.begin(), earlier_.end());
  earlier_.push_back(tracks.features);
  if (earlier_.size() > EARLIER_FRAMES)
  {
    earlier_.pop_front();
  }
  if (drawing_.exchange(true))
  {
    return;  // whoever draws has not caught up
  }
  output_thread_.post([this, tracks = std::move(tracks), left = pipeline.cameras.left.model,
                       right = pipeline.cameras.right.model] { publishTracks(tracks, left, right); });
}

// --------------------------------------------------------------------------------------------------------- any thread

void VioRos::restart(const std::string& reason, bool forget_map)
{
  std::lock_guard<std::mutex> restart_lock(restart_mutex_);
  const PipelinePtr before = pipeline();
  if (!before)
  {
    return;
  }
  warnings_.warn(reason);
  // A new object rather than Vio::reset(): pairs and samples of the old time that are in work end with the old one.
  const auto pipeline = std::make_shared<Pipeline>(*before);
  if (pipeline->mapper && forget_map)
  {
    pipeline->mapper = std::make_shared<Mapper>(pipeline->cameras, options_.mapper, runtime_);
  }
  pipeline->vio = makeVio(pipeline->cameras, pipeline->vio_options, pipeline->mapper);
  replacePipeline(pipeline);
}

void VioRos::replacePipeline(PipelinePtr pipeline)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    pipeline_.swap(pipeline);  // the old one ends after the lock
    ++generation_;
    pairs_.clear();
    matcher_.clear();
    odom_path_.clear();
    odom_history_.clear();
    T_map_odom_ = pipeline_->mapper ? pipeline_->mapper->T_map_odom() : Eigen::Isometry3d::Identity();
    map_covariance_.reset();
    last_odometry_ns_ = 0;
    problem_.clear();
    problem_failed_ = false;
  }
  imu_arrived_.notify_all();
  diagnostics_.reset();
}

VioRos::PipelinePtr VioRos::pipeline() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return pipeline_;
}

std::shared_ptr<Vio> VioRos::makeVio(const StereoCalibration& cameras, const VioOptions& options,
                                     const std::shared_ptr<Mapper>& mapper) const
{
  auto vio = std::make_shared<Vio>(cameras, options, runtime_);
  if (mapper)
  {
    vio->setKeyframeCallback([mapper](const MapFrame& frame) { mapper->add(frame); });
  }
  return vio;
}

}  // namespace pi_slam
