#include "map/mapper_impl.h"

#include <pi_node/option_check.h>
#include <pthread.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <utility>

#include "map/map_file.h"

namespace pi_slam
{

namespace
{

constexpr size_t MOST_WAITING_FIXES = 200;

/// The pose of odom in map, turned about z alone, that puts the body there.
Eigen::Isometry3d uprightMapOdom(const Eigen::Isometry3d& T_odom_body, const Eigen::Isometry3d& T_map_body)
{
  const Eigen::Matrix3d R = T_map_body.linear() * T_odom_body.linear().transpose();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  // The turn about z that is nearest to R.
  T.linear() =
      Eigen::AngleAxisd(std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1)), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() = T_map_body.translation() - T.linear() * T_odom_body.translation();
  return T;
}

void checkPicture(const cv::Mat& picture, const CameraModel& camera, const char* side)
{
  if (!picture.empty() && (picture.type() != CV_8UC1 || picture.cols != camera.width || picture.rows != camera.height))
  {
    throw std::invalid_argument(std::string("map frame: the ") + side + " picture has " + std::to_string(picture.cols) +
                                " x " + std::to_string(picture.rows) + " px of type " + std::to_string(picture.type()) +
                                ", must be CV_8UC1 of " + std::to_string(camera.width) + " x " +
                                std::to_string(camera.height));
  }
}

bool isPose(const Eigen::Isometry3d& T)
{
  const Eigen::Matrix3d R = T.linear();
  return T.matrix().allFinite() && (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() <= 1e-3 &&
         T.translation().norm() < 1e6;
}

void checkFrame(const MapFrame& frame, const StereoCalibration& calibration)
{
  checkPicture(frame.left, calibration.left.model, "left");
  checkPicture(frame.right, calibration.right.model, "right");
  if (!isPose(frame.T_odom_body))
  {
    throw std::invalid_argument("map frame: T_odom_body of " + std::to_string(frame.stamp_ns) +
                                " ns is no pose within 1000 km; give odometry's pose, or leave the frame out");
  }
}

bool hasKeyframes(const MapData& map)
{
  return std::any_of(map.nodes.begin(), map.nodes.end(), [](const MapNode& node) { return node.isKeyframe(); });
}

}  // namespace

void MapperOptions::validate() const
{
  const pi_node::OptionCheck check("map");
  check.range("keyframe_distance_m", keyframe_distance_m, 0.05, 10.0);
  check.range("keyframe_angle_deg", keyframe_angle_deg, 1.0, 90.0);
  check.range("features", features, 50, 2000);
  check.range<size_t>("max_keyframes", max_keyframes, 10, 100000);
  check.range<size_t>("max_stored_keyframes", max_stored_keyframes, 10, 1000000);
  if (!tile_folder.empty() && !std::filesystem::is_directory(tile_folder))
  {
    throw std::invalid_argument("map/tile_folder = \"" + tile_folder + "\", must be a folder that exists, or empty");
  }
  check.range("max_landmark_range_m", max_landmark_range_m, 1.0, 200.0);
  check.range("voxel_m", voxel_m, 0.01, 5.0);
  check.range("min_inliers", min_inliers, 8, 1000);
}

void Mapper::Impl::reset()
{
  graph.clear();
  segment.reset();
  loaded = false;
  was_localized = true;
  large_correction = false;
  waiting_fixes.clear();
  loops = 0;
  last_add_ms = 0.0;
  filter = DriftFilter();
}

void Mapper::Impl::publish()
{
  const MapData& data = graph.data();
  MapStatistics statistics;
  statistics.bytes = graph.bytes();
  statistics.keyframes = graph.counts().keyframes;
  statistics.keyframes_in_memory = graph.counts().in_memory;
  statistics.landmarks = graph.counts().landmarks;
  statistics.bytes_on_disk = graph.bytesOnDisk();
  statistics.disk_defect = graph.diskDefect();
  statistics.loops = loops;
  statistics.loaded = loaded;
  statistics.localized = !loaded || (was_localized && segment && ownPart() == 0);
  statistics.covariance = filter.covariance();
  statistics.last_add_ms = last_add_ms;
  statistics.fixes = data.fixes.size();
  if (data.origin && data.earth)
  {
    const LocalFrame local(*data.origin);
    statistics.on_earth = MapOnEarth{local.T_earth_local() * data.earth->T_local_map(),
                                     local.toGeo(data.earth->position), data.earth->heading};
  }
  std::lock_guard<std::mutex> lock(published_mutex);
  published = statistics;
  published_T_map_odom = filter.T_map_odom();
}

MapData Mapper::Impl::placedNodes() const
{
  MapData copy;  // features are shared
  for (const MapNode& node : graph.data().nodes)
  {
    if (isPlaced(node.segment))
    {
      copy.nodes.push_back(node);
    }
  }
  return copy;
}

void Mapper::Impl::dropWaiting()
{
  std::lock_guard<std::mutex> lock(queue_mutex);
  skipped += next_frame ? 1 : 0;
  next_frame.reset();
  queue_changed.notify_all();
}

void Mapper::Impl::run()
{
  std::unique_lock<std::mutex> lock(queue_mutex);
  for (;;)
  {
    queue_changed.wait(lock, [&] { return next_frame || stopping; });
    if (!next_frame)
    {
      return;
    }
    const MapFrame frame = std::move(*next_frame);
    const bool begins_anew = std::exchange(next_begins_anew, false);
    next_frame.reset();
    busy = true;
    lock.unlock();
    stage.run([&] { process(frame, begins_anew); });
    lock.lock();
    busy = false;
    queue_changed.notify_all();
  }
}

Mapper::Mapper(const StereoCalibration& calibration, const MapperOptions& options,
               std::shared_ptr<pi_runtime::Runtime> runtime)
{
  options.validate();
  calibration.left.model.validate();
  calibration.right.model.validate();
  if (calibration.left.model.width != calibration.right.model.width ||
      calibration.left.model.height != calibration.right.model.height)
  {
    throw std::invalid_argument("map: the cameras have pictures of different sizes; give a pair of the same size");
  }
  if (options.kernel_tasks && !runtime)
  {
    throw std::invalid_argument("map/kernel_tasks = true, but there is no runtime; give one, or set it to false");
  }
  impl_ = std::make_unique<Impl>(calibration, options, runtime);
  if (options.threaded)
  {
    impl_->thread = std::thread([this] { impl_->run(); });
    pthread_setname_np(impl_->thread.native_handle(), "pi_slam_map");
  }
}

Mapper::~Mapper()
{
  {
    std::lock_guard<std::mutex> lock(impl_->queue_mutex);
    impl_->stopping = true;
    impl_->next_frame.reset();
  }
  impl_->queue_changed.notify_all();
  if (impl_->thread.joinable())
  {
    impl_->thread.join();
  }
}

void Mapper::add(const MapFrame& frame)
{
  checkFrame(frame, impl_->calibration);
  std::unique_lock<std::mutex> lock(impl_->queue_mutex);
  if (impl_->options.threaded)
  {
    impl_->skipped += impl_->next_frame ? 1 : 0;
    impl_->next_frame = frame;
    impl_->queue_changed.notify_all();
    return;
  }
  const bool begins_anew = std::exchange(impl_->next_begins_anew, false);
  lock.unlock();
  impl_->process(frame, begins_anew);
}

void Mapper::addFix(const GnssFix& fix)
{
  if (!fix.antenna.isValid() || !(fix.deviation > 0.0 && fix.deviation < 1e6) ||
      !(fix.up_deviation > 0.0 && fix.up_deviation < 1e6) || !fix.p_body_antenna.allFinite())
  {
    throw std::invalid_argument("GNSS: latitude " + std::to_string(fix.antenna.latitude_deg) + ", longitude " +
                                std::to_string(fix.antenna.longitude_deg) + ", height " +
                                std::to_string(fix.antenna.height_m) + " m, deviation " +
                                std::to_string(fix.deviation) + " and " + std::to_string(fix.up_deviation) +
                                " m, or the place of the antenna, are out of range");
  }
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  impl_->waiting_fixes.push_back(fix);
  if (impl_->waiting_fixes.size() > MOST_WAITING_FIXES)
  {
    impl_->waiting_fixes.pop_front();
  }
}

void Mapper::flush()
{
  std::unique_lock<std::mutex> lock(impl_->queue_mutex);
  impl_->queue_changed.wait(lock, [&] { return !impl_->next_frame && !impl_->busy; });
}

void Mapper::odometryReset()
{
  impl_->dropWaiting();  // it is of the segment that has ended
  std::lock_guard<std::mutex> lock(impl_->queue_mutex);
  impl_->next_begins_anew = true;
}

void Mapper::setPose(const Eigen::Isometry3d& T_odom_body, const Eigen::Isometry3d& T_map_body)
{
  if (!isPose(T_odom_body) || !isPose(T_map_body))
  {
    throw std::invalid_argument("map: the pose to be set, or that of odometry, is no pose within 1000 km");
  }
  // Not while a frame is in work: it may be the first one after a reset.
  std::unique_lock<std::mutex> queue_lock(impl_->queue_mutex);
  impl_->queue_changed.wait(queue_lock, [&] { return !impl_->busy; });
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  if (impl_->next_begins_anew)
  {
    impl_->segment.reset();  // it has ended: its frames stay where they are
  }
  impl_->moveTo(uprightMapOdom(T_odom_body, T_map_body));
  impl_->publish();
}

Eigen::Isometry3d Mapper::T_map_odom() const
{
  std::lock_guard<std::mutex> lock(impl_->published_mutex);
  return impl_->published_T_map_odom;
}

std::vector<std::pair<int64_t, Eigen::Isometry3d>> Mapper::path() const
{
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  std::vector<std::pair<int64_t, Eigen::Isometry3d>> path;
  for (const MapNode& node : impl_->graph.data().nodes)
  {
    if (!node.loaded && impl_->isPlaced(node.segment))
    {
      path.emplace_back(node.stamp_ns, node.T_map_body());
    }
  }
  return path;
}

std::vector<MapPoint> Mapper::cloud() const
{
  std::lock_guard<std::mutex> cloud_lock(impl_->cloud_mutex);
  MapData copy;
  {
    std::lock_guard<std::mutex> lock(impl_->map_mutex);
    copy = impl_->placedNodes();
  }
  return impl_->voxels.update(copy);
}

MapStatistics Mapper::statistics() const
{
  MapStatistics statistics;
  {
    std::lock_guard<std::mutex> lock(impl_->published_mutex);
    statistics = impl_->published;
  }
  std::lock_guard<std::mutex> lock(impl_->queue_mutex);
  statistics.skipped = impl_->skipped;
  return statistics;
}

std::string Mapper::stage() const
{
  return impl_->stage.status().text();
}

void Mapper::save(const std::string& file) const
{
  MapData part;  // of those whose places relative to each other are not known
  {
    std::lock_guard<std::mutex> lock(impl_->map_mutex);
    part = impl_->graph.copyOf(impl_->loaded ? 0 : impl_->graph.largestPart(), impl_->newestGrid());
  }
  if (!hasKeyframes(part))
  {
    throw MapError("map " + file + ": there are no keyframes to be saved; drive first");
  }
  writeMap(file, part, impl_->calibration);
}

void Mapper::load(const std::string& file)
{
  size_t in_memory = 0;
  MapData loaded = readMap(file, impl_->calibration,
                           [&](MapNode* node)
                           {
                             in_memory += node->features ? 1 : 0;
                             if (in_memory > impl_->options.max_keyframes)
                             {
                               impl_->graph.store(node);
                             }
                           });
  if (!hasKeyframes(loaded))
  {
    throw MapError("map " + file + ": it has no keyframes; make the map anew");
  }
  impl_->dropWaiting();
  std::lock_guard<std::mutex> lock(impl_->map_mutex);
  impl_->reset();
  impl_->graph.load(std::move(loaded));
  impl_->loaded = true;
  impl_->was_localized = false;
  impl_->boundMap();
  impl_->publish();
}

}  // namespace pi_slam
