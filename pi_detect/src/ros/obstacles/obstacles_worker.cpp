#include "ros/obstacles/obstacles_worker.h"

#include <pi_node/durations.h>
#include <pthread.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <stdexcept>
#include <utility>

namespace pi_detect
{

using Clock = std::chrono::steady_clock;

static constexpr size_t KEPT_TRACKS = 30;

ObstaclesWorker::ObstaclesWorker(const ros::NodeHandle& node, const ObstaclesRosOptions& options,
                                 const StereoTopics& topics, std::shared_ptr<StereoStages> stages,
                                 pi_node::WarningBoard* warnings, ObstaclesDiagnostics* diagnostics,
                                 std::function<void(const Found&)> publish)
  : options_(options)
  , warnings_(warnings)
  , diagnostics_(diagnostics)
  , publish_(std::move(publish))
  , motion_(node, options.odom_frame, options.base_link_frame)
  , pairing_(pi_node::nanoseconds(options.pair_tolerance_s))
  , rate_limit_(options.max_rate_hz)
  , finder_(options, topics, &motion_, std::move(stages))
  , tracker_(options.tracker)
  , answers_("pictures", "obstacles")
{
}

void ObstaclesWorker::start()
{
  thread_ = std::thread([this] { work(); });
}

void ObstaclesWorker::stop()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  motion_.stop();
  job_changed_.notify_all();
  thread_.join();
}

// ---------------------------------------------------------------------------------------------------------- any thread

void ObstaclesWorker::add(Side side, const pi_os_transport::zero_copy::ImageHandle& picture)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (const auto pair = pairing_.add(side, picture))
  {
    StereoJob job;
    job.pair = {pair->first, pair->second};
    offer(std::move(job));
  }
}

void ObstaclesWorker::add(const stereo_msgs::DisparityImageConstPtr& disparity)
{
  StereoJob job;
  job.disparity = disparity;
  std::lock_guard<std::mutex> lock(mutex_);
  offer(std::move(job));
}

void ObstaclesWorker::offer(StereoJob job)
{
  const int64_t stamp_ns = fromMsg(job.header().stamp);
  if (!rate_limit_.take(stamp_ns))
  {
    ++figures_.left_out;
    answers_.leftOut(stamp_ns);
    return;
  }
  answers_.taken(stamp_ns);
  figures_.dropped += job_ ? 1 : 0;
  job_ = std::move(job);
  job_changed_.notify_one();
}

void ObstaclesWorker::add(const Track2DArrayConstPtr& tracks)
{
  std::lock_guard<std::mutex> lock(mutex_);
  if (!recent_tracks_.empty() && tracks->header.stamp < recent_tracks_.back()->header.stamp)
  {
    recent_tracks_.clear();  // time began anew
  }
  recent_tracks_.push_back(tracks);
  if (recent_tracks_.size() > KEPT_TRACKS)
  {
    recent_tracks_.pop_front();
  }
}

void ObstaclesWorker::add(Side side, const sensor_msgs::CameraInfoConstPtr& info)
{
  std::lock_guard<std::mutex> lock(mutex_);
  infos_[side] = info;
}

void ObstaclesWorker::take(bool wanted)
{
  answers_.take(wanted);
  if (wanted)
  {
    return;
  }
  std::lock_guard<std::mutex> lock(mutex_);
  pairing_.clear();
  job_.reset();
  recent_tracks_.clear();
}

void ObstaclesWorker::report(ObstaclesFigures* figures)
{
  std::lock_guard<std::mutex> lock(mutex_);
  *figures = figures_;
  figures->single = pairing_.dropped();
}

// ---------------------------------------------------------------------------------------------------------- obs_worker

void ObstaclesWorker::work()
{
  pthread_setname_np(pthread_self(), "obs_worker");
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    job_changed_.wait(lock, [this] { return stopping_ || job_; });
    if (stopping_)
    {
      return;
    }
    StereoJob job = std::move(*job_);
    job_.reset();
    job.infos[LEFT] = infos_[LEFT];
    job.infos[RIGHT] = infos_[RIGHT];
    lock.unlock();
    try
    {
      workOn(job);
    }
    catch (const std::invalid_argument& error)
    {
      warnings_->error(error.what());
    }
    catch (const std::exception& error)
    {
      warnings_->error(std::string("a pair cannot be used: ") + error.what());
    }
    answers_.workedOff(fromMsg(job.header().stamp));
    lock.lock();
  }
}

void ObstaclesWorker::workOn(const StereoJob& job)
{
  if (const ObstacleProblem problem = finder_.prepare(job); !problem.text.empty())
  {
    setProblem(problem);
    return;
  }
  const ros::Time stamp = job.header().stamp;
  std::optional<VehicleState> vehicle;
  PairFigures figures;
  const StereoObstacles::Result result = finder_.find(
      job,
      [&]() -> std::optional<Eigen::Isometry3d>
      {
        vehicle = motionAt(stamp, answers_.waits(options_.tf_wait_s));
        return vehicle ? std::make_optional(vehicle->T_odom_base) : std::nullopt;
      },
      &figures);
  setProblem({});
  if (const std::string limit = nearLimitText(figures.nearest_visible_m); !limit.empty())
  {
    warnings_->warn(limit);
  }
  if (result.coverage < options_.min_coverage)
  {
    diagnostics_->addPair(figures);  // publishing nothing, not "no obstacles": the way may be blocked
    return;
  }
  const Clock::time_point begin = Clock::now();
  const std::vector<ObjectTrack> tracks = tracksAt(stamp, &figures.track_age_s);
  const std::vector<Obstacle> obstacles =
      tracker_.update(fromMsg(stamp), vehicle.value_or(VehicleState()), result.obstacles, tracks, finder_.geometry(),
                      finder_.T_base_left(), finder_.minDepth());
  figures.track_s = pi_node::secondsSince(begin);
  publish_({job, result, obstacles, labels_, finder_, vehicle});

  figures.latency_s = (ros::Time::now() - stamp).toSec();
  figures.obstacles = obstacles.size();
  figures.nearest_m = figures.time_to_collision_s = std::numeric_limits<double>::infinity();
  for (const Obstacle& obstacle : obstacles)
  {
    figures.nearest_m = std::min(figures.nearest_m, obstacle.distance_m);
    figures.time_to_collision_s = std::min(figures.time_to_collision_s, obstacle.time_to_collision_s);
  }
  diagnostics_->addPair(figures);
}

void ObstaclesWorker::setProblem(const ObstacleProblem& problem)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    figures_.problem = problem.text;
    figures_.failed = problem.failed;
  }
  if (problem.failed)
  {
    warnings_->error(problem.text);
  }
  else if (!problem.text.empty())
  {
    warnings_->warn(problem.text);
  }
}

std::vector<ObjectTrack> ObstaclesWorker::tracksAt(const ros::Time& stamp, std::optional<double>* age_s)
{
  const auto age = [&stamp](const Track2DArrayConstPtr& tracks) { return (stamp - tracks->header.stamp).toSec(); };
  Track2DArrayConstPtr nearest;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const auto found =
        std::min_element(recent_tracks_.begin(), recent_tracks_.end(),
                         [&age](const auto& a, const auto& b) { return std::abs(age(a)) < std::abs(age(b)); });
    nearest = found == recent_tracks_.end() ? nullptr : *found;
  }
  if (!nearest || std::abs(age(nearest)) > options_.max_track_age_s)
  {
    return {};
  }
  *age_s = age(nearest);
  for (const Track2D& track : nearest->tracks)
  {
    labels_[static_cast<int>(track.class_id)] = track.label;
  }
  std::vector<ObjectTrack> tracks = fromMsg(*nearest);
  for (ObjectTrack& track : tracks)
  {
    const auto move_x = static_cast<float>(track.velocity_x * **age_s);
    const auto move_y = static_cast<float>(track.velocity_y * **age_s);
    track.box.x1 += move_x;
    track.box.x2 += move_x;
    track.box.y1 += move_y;
    track.box.y2 += move_y;
    if (!options_.tracks_rectified)
    {
      track.box = finder_.rectify(track.box);
    }
  }
  return tracks;
}

std::optional<VehicleState> ObstaclesWorker::motionAt(const ros::Time& stamp, int64_t until_ns)
{
  std::string problem;
  std::optional<VehicleState> state = motion_.at(stamp, until_ns, &problem);
  if (!problem.empty())
  {
    warnings_->warn(state ? problem
                          : problem +
                                ": velocities of obstacles are relative to the vehicle; start the odometry, or "
                                "set odom_frame");
  }
  if (worked_with_motion_ != state.has_value())
  {
    worked_with_motion_ = state.has_value();
    tracker_.clear();  // it follows in another frame now
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    figures_.motion_problem = problem;
    figures_.motion_known = state.has_value();
  }
  return state;
}

}  // namespace pi_detect
