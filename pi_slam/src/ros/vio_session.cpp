#include "ros/vio_session.h"

#include <pi_node/durations.h>
#include <pi_node/vehicle_clock.h>

namespace pi_slam
{

VioSession::VioSession(const VioRosOptions& options, VioPipeline::RuntimePtr runtime, pi_node::WarningBoard* warnings,
                       VioDiagnostics* diagnostics)
  : options_(options)
  , runtime_(std::move(runtime))
  , warnings_(warnings)
  , diagnostics_(diagnostics)
  , matcher_(options.pair_tolerance_s, options.pair_wait_s)
{
}

VioPipeline::Ptr VioSession::pipeline() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return pipeline_;
}

bool VioSession::replace(VioPipeline::Ptr pipeline)
{
  std::lock_guard<std::mutex> restart_lock(restart_mutex_);
  return replaceLocked(std::move(pipeline));
}

void VioSession::restart(const std::string& reason, bool forget_map)
{
  std::lock_guard<std::mutex> restart_lock(restart_mutex_);
  const VioPipeline::Ptr before = pipeline();
  if (before)
  {
    warnings_->warn(reason);
    replaceLocked(before->again(options_, runtime_, forget_map));
  }
}

bool VioSession::replaceLocked(VioPipeline::Ptr pipeline)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    pipeline_.swap(pipeline);  // the old one ends after the lock
    ++generation_;
    matcher_.clear();
    map_place_ = {pipeline_->mapper ? pipeline_->mapper->T_map_odom() : Eigen::Isometry3d::Identity(), std::nullopt,
                  std::nullopt};
    path_.clear();
    history_.clear();
    last_odometry_ns = 0;
    problem_ = {};
  }
  imu_arrived_.notify_all();
  diagnostics_->reset();
  return pipeline != nullptr;
}

void VioSession::setProblem(const std::string& problem, bool failed)
{
  {
    VioPipeline::Ptr before;
    std::lock_guard<std::mutex> lock(mutex_);
    if (problem_.text != problem)
    {
      waiting_since_ns_ = pi_node::vehicleNs();
    }
    problem_ = {problem, failed};
    if (failed && pipeline_)
    {
      pipeline_.swap(before);
      ++generation_;
      matcher_.clear();
    }
  }
  if (failed)
  {
    warnings_->error(problem + "; no odometry until this is right");
  }
  else if (pi_node::secondsBetween(waiting_since_ns_, pi_node::vehicleNs()) > options_.input_timeout_s)
  {
    warnings_->warn(problem);
  }
}

VioSession::Problem VioSession::problem() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return problem_;
}

std::optional<double> VioSession::addPicture(const VioPipeline::Ptr& pipeline, int camera, int64_t stamp_ns,
                                             const cv::Mat& picture, const std::string& frame)
{
  std::optional<double> mismatch_s;
  {
    std::vector<PicturePair> pairs;
    std::lock_guard<std::mutex> lock(mutex_);
    if (pipeline_ != pipeline)
    {
      return std::nullopt;
    }
    if (camera == LEFT && left_frame_ != frame)
    {
      left_frame_ = frame;
    }
    matcher_.add(camera, stamp_ns, picture, &pairs);
    mismatch_s = matcher_.takeMismatch();
    for (PicturePair& pair : pairs)
    {
      delay_ns = last_imu_ns - pair.stamp_ns;
      pairs_.push_back({std::move(pair), pipeline_, generation_, false});
    }
    while (pairs_.size() > static_cast<size_t>(options_.queue_size))
    {
      pairs_.pop_front();
      ++dropped_pairs_;
    }
  }
  pairs_changed_.notify_one();
  return mismatch_s;
}

void VioSession::clearPairs()
{
  std::lock_guard<std::mutex> lock(mutex_);
  matcher_.clear();
  pairs_.clear();
}

std::optional<VioSession::Work> VioSession::take(const std::function<int64_t()>& waits)
{
  std::unique_lock<std::mutex> lock(mutex_);
  pairs_changed_.wait(lock, [this] { return stopping_ || !pairs_.empty(); });
  if (stopping_)
  {
    return std::nullopt;
  }
  Work work = std::move(pairs_.front());
  pairs_.pop_front();
  const auto replaced = [&] { return stopping_ || generation_ != work.generation; };
  const auto covered = [&] { return work.pipeline->vio->imuCovers(work.pair.stamp_ns); };
  worker_waits_for_imu_ = true;
  // An IMU that fell silent is waited for once.
  const bool silent = last_imu_ns == silent_since_ns_;
  work.covered =
      replaced() || covered() ||
      (!silent && pi_node::waitUntil(&imu_arrived_, &lock, waits(), [&] { return replaced() || covered(); }));
  silent_since_ns_ = work.covered ? -1 : last_imu_ns.load();
  worker_waits_for_imu_ = false;
  const bool forgotten = replaced();
  lock.unlock();
  if (forgotten)
  {
    work.pipeline.reset();  // may be the last to hold it
  }
  return work;
}

void VioSession::imuArrived()
{
  if (worker_waits_for_imu_)
  {
    // The lock ensures that the worker is not between its check and its wait.
    std::unique_lock<std::mutex>(mutex_).unlock();
    imu_arrived_.notify_all();
  }
}

void VioSession::stop()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  pairs_changed_.notify_all();
  imu_arrived_.notify_all();
}

void VioSession::addOdometry(const VioPipeline& pipeline, int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (pipeline_.get() == &pipeline)
  {
    history_.add(stamp_ns, T_odom_base);
  }
}

void VioSession::updateMapPlace(const VioPipeline& pipeline, uint64_t generation)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (generation_ == generation)
  {
    map_place_.T_map_odom = pipeline.mapper->T_map_odom();
    const MapStatistics map = pipeline.mapper->statistics();
    map_place_.covariance = map.localized ? std::optional(map.covariance) : std::nullopt;
    map_place_.T_earth_map = map.on_earth ? std::optional(map.on_earth->T_earth_map) : std::nullopt;
  }
}

void VioSession::setMapPlace(const Place& place, const Eigen::Isometry3d& T_map_odom)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (generation_ == place.generation)
  {
    map_place_.T_map_odom = place.pipeline->mapper ? place.pipeline->mapper->T_map_odom() : T_map_odom;
  }
}

VioSession::MapPlace VioSession::mapPlace() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return map_place_;
}

VioSession::Place VioSession::placeAt(int64_t stamp_ns) const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return {pipeline_, generation_, map_place_.T_map_odom, history_.at(stamp_ns), history_.newest()};
}

void VioSession::keepForPath(uint64_t generation, int64_t stamp_ns, const Eigen::Isometry3d& T_odom_body)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (generation_ == generation)
  {
    if (path_.empty() ||
        !((path_.back().second.translation() - T_odom_body.translation()).norm() < options_.path_spacing_m))
    {
      path_.emplace_back(stamp_ns, T_odom_body);
    }
    if (path_.size() > static_cast<size_t>(options_.path_length))
    {
      path_.pop_front();
    }
  }
}

VioSession::Path VioSession::odomPathInMap() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  Path in_map;
  for (const auto& [stamp_ns, T_odom_body] : path_)
  {
    in_map.emplace_back(stamp_ns, map_place_.T_map_odom * T_odom_body);
  }
  return in_map;
}

std::string VioSession::leftFrame() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return left_frame_;
}

void VioSession::fill(VioFigures* figures) const
{
  VioPipeline::Ptr pipeline;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    pipeline = pipeline_;
    figures->problem = problem_.text;
    figures->failed = problem_.failed;
    figures->dropped_pairs = dropped_pairs_;
    figures->late_pictures = matcher_.late();
    figures->single_pictures = matcher_.single();
  }
  figures->delay_s = pi_node::seconds(delay_ns);
  if (pipeline)
  {
    figures->stages = pipeline->vio->stages();
    figures->rig = pipeline->vio->rig();
  }
  if (pipeline && pipeline->mapper)
  {
    figures->map = pipeline->mapper->statistics();
    figures->stages.emplace_back("slam_map", pipeline->mapper->stage());
  }
}

}  // namespace pi_slam
