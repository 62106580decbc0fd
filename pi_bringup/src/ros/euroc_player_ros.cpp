#include <pi_bringup/ros/euroc_player_ros.h>
#include <pi_bringup/ros/parameters.h>
#include <rosgraph_msgs/Clock.h>

#include <cmath>
#include <stdexcept>
#include <utility>

namespace pi_bringup
{

namespace
{

using ImagePublisher = pi_os_transport::zero_copy::Publisher<sensor_msgs::Image>;

/// The path is one message with all its poses: more often would only cost.
constexpr int64_t PATH_PERIOD_NS = 200000000;

}  // namespace

void EurocPlayerOptions::validate() const
{
  checkOption(!folder.empty(), "folder", "\"\"", "the folder of an EuRoC recording (the one that contains mav0)");
  checkOption(rate > 0.0 && rate <= 1000.0, "rate", std::to_string(rate), "in (0, 1000]");
  checkOption(timeline.start_s >= 0.0, "start_s", std::to_string(timeline.start_s), "0 or more");
  checkOption(timeline.duration_s >= 0.0, "duration_s", std::to_string(timeline.duration_s), "0 (all) or more");
  checkOption(clock_rate_hz > 0.0 && clock_rate_hz <= 10000.0, "clock_rate_hz", std::to_string(clock_rate_hz),
              "in (0, 10000]");
  checkOption(path_spacing_m > 0.0, "path_spacing_m", std::to_string(path_spacing_m), "above 0");
  checkOption(queue_size >= 1, "queue_size", std::to_string(queue_size), "1 or more (0 would be unbounded in roscpp)");
  checkOption(prefetch_depth >= 1 && prefetch_depth <= 1000, "prefetch_depth", std::to_string(prefetch_depth),
              "in [1, 1000]");
  checkOption(!stamp_at_handover || !keep_stamps, "stamp_at_handover", "true", "combined with keep_stamps: false");
  checkOption(!publish_clock || keep_stamps, "publish_clock", "true", "combined with keep_stamps: true");
  frames.validate();
}

EurocPlayerOptions EurocPlayerOptions::load(const ros::NodeHandle& node)
{
  EurocPlayerOptions options;
  loadParameter(node, "folder", &options.folder);
  loadParameter(node, "rate", &options.rate);
  loadParameter(node, "loop", &options.loop);
  loadParameter(node, "start_at_first_image", &options.timeline.start_at_first_image);
  loadParameter(node, "start_s", &options.timeline.start_s);
  loadParameter(node, "duration_s", &options.timeline.duration_s);
  loadParameter(node, "map_frame", &options.frames.map_frame);
  loadParameter(node, "base_link_frame", &options.frames.base_link_frame);
  loadParameter(node, "imu_frame", &options.frames.imu_frame);
  loadParameter(node, "left_frame", &options.frames.left_frame);
  loadParameter(node, "right_frame", &options.frames.right_frame);
  loadParameter(node, "body_in_base", &options.frames.body_in_base);
  loadParameter(node, "publish_tf", &options.publish_tf);
  loadParameter(node, "keep_stamps", &options.keep_stamps);
  loadParameter(node, "stamp_at_handover", &options.stamp_at_handover);
  loadParameter(node, "publish_clock", &options.publish_clock);
  loadParameter(node, "clock_rate_hz", &options.clock_rate_hz);
  loadParameter(node, "path_spacing_m", &options.path_spacing_m);
  loadParameter(node, "queue_size", &options.queue_size);
  loadParameter(node, "prefetch_depth", &options.prefetch_depth);
  loadParameter(node, "exit_when_done", &options.exit_when_done);
  loadParameter(node, "wait_for_subscribers", &options.wait_for_subscribers);
  options.validate();
  return options;
}

EurocPlayerRos::EurocPlayerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : node_(std::move(node))
  , options_(EurocPlayerOptions::load(private_node))
  , dataset_(EurocDataset::load(options_.folder))
  , messages_(dataset_, options_.frames)
  , timeline_(Timeline::build(dataset_, options_.timeline))
  , pacer_(options_.rate)
  , status_(private_node, "euroc_player")
{
  const auto picture_queue = static_cast<uint32_t>(options_.queue_size);
  left_image_ = ImagePublisher(gate_.advertise<sensor_msgs::Image>(node_, "left/image_raw", picture_queue));
  left_info_ = gate_.advertise<sensor_msgs::CameraInfo>(node_, "left/camera_info", picture_queue);
  if (dataset_.right)
  {
    right_image_ = ImagePublisher(gate_.advertise<sensor_msgs::Image>(node_, "right/image_raw", picture_queue));
    right_info_ = gate_.advertise<sensor_msgs::CameraInfo>(node_, "right/camera_info", picture_queue);
  }
  if (dataset_.imu)
  {
    imu_ = gate_.advertise<sensor_msgs::Imu>(node_, "imu/data", 10 * picture_queue);
  }
  if (!dataset_.ground_truth.empty())
  {
    odometry_ = gate_.advertise<nav_msgs::Odometry>(node_, "ground_truth/odometry", 10 * picture_queue);
    path_ = node_.advertise<nav_msgs::Path>("ground_truth/path", 2, true);
  }
  tf_static_ = node_.advertise<tf2_msgs::TFMessage>("/tf_static", 10, true);
  if (options_.publish_tf)
  {
    tf_ = gate_.advertise<tf2_msgs::TFMessage>(node_, "/tf", 100, false);
  }
  if (options_.publish_clock)
  {
    clock_ = node_.advertise<rosgraph_msgs::Clock>("/clock", 10);
  }
  gate_.require(options_.wait_for_subscribers);
  tf_static_.publish(messages_.staticTransforms(ros::Time(0)));
  path_message_.header.frame_id = options_.frames.map_frame;

  if (options_.rate != 1.0 && !options_.keep_stamps && !options_.stamp_at_handover)
  {
    ROS_WARN_STREAM_NAMED("playback", "rate = " << options_.rate
                                                << " without keep_stamps: stamps keep their recorded distances and "
                                                   "move away from the clock; use keep_stamps with publish_clock");
  }
  ROS_INFO_STREAM_NAMED("playback", options_.folder << ": " << timeline_.items.size() << " messages in "
                                                    << static_cast<double>(timeline_.period_ns) * 1e-9 << " s at rate "
                                                    << options_.rate << (options_.loop ? ", looped" : ""));
}

EurocPlayerRos::~EurocPlayerRos()
{
  stop();
}

void EurocPlayerRos::stop()
{
  stopped_ = true;
  gate_.stop();
  pacer_.stop();
}

std::unique_ptr<FramePrefetcher> EurocPlayerRos::prefetch(Stream stream)
{
  const Camera& camera = stream == Stream::LEFT ? dataset_.left : *dataset_.right;
  std::vector<std::string> paths;
  for (const TimelineItem& item : timeline_.items)
  {
    if (item.stream == stream)
    {
      paths.push_back(camera.images[item.index].path);
    }
  }
  const auto producer = [paths, width = camera.calibration.width, height = camera.calibration.height,
                         loop = options_.loop, position = size_t{0}]() mutable -> std::optional<Frame>
  {
    if (loop && position == paths.size())
    {
      position = 0;
    }
    if (position == paths.size())
    {
      return std::nullopt;
    }
    return decodeGreyImage(paths[position++], width, height);
  };
  return std::make_unique<FramePrefetcher>(producer, static_cast<size_t>(options_.prefetch_depth));
}

void EurocPlayerRos::play()
{
  left_frames_ = prefetch(Stream::LEFT);
  if (dataset_.right)
  {
    right_frames_ = prefetch(Stream::RIGHT);
  }
  status_.waiting();
  if (gate_.wait())
  {
    status_.playing();
    pacer_.start(timeline_.start_ns, monotonicNow());
    stamp_offset_ns_ =
        options_.keep_stamps ? 0 : static_cast<int64_t>(ros::WallTime::now().toNSec()) - timeline_.start_ns;
    next_clock_ns_ = timeline_.start_ns;
    int64_t lap_shift_ns = 0;
    while (playLap(lap_shift_ns) && options_.loop)
    {
      lap_shift_ns += timeline_.period_ns;
    }
  }
  left_frames_->stop();
  if (right_frames_)
  {
    right_frames_->stop();
  }
  status_.finished();
}

bool EurocPlayerRos::playLap(int64_t lap_shift_ns)
{
  for (const TimelineItem& item : timeline_.items)
  {
    const int64_t due_ns = item.stamp_ns + lap_shift_ns;
    if (!publishClockUntil(due_ns) || !pacer_.waitUntil(due_ns))
    {
      return false;
    }
    publishItem(item, lap_shift_ns);
  }
  return !stopped_;
}

bool EurocPlayerRos::publishClockUntil(int64_t recorded_ns)
{
  if (!options_.publish_clock)
  {
    return true;
  }
  const int64_t period_ns = std::llround(1e9 / options_.clock_rate_hz);
  for (; next_clock_ns_ <= recorded_ns; next_clock_ns_ += period_ns)
  {
    if (!pacer_.waitUntil(next_clock_ns_))
    {
      return false;
    }
    // Recorded time starts anew with each lap, as the recorded stamps do.
    const int64_t lap_ns = (next_clock_ns_ - timeline_.start_ns) % timeline_.period_ns;
    rosgraph_msgs::Clock clock;
    clock.clock = toTime(timeline_.start_ns + lap_ns);
    clock_.publish(clock);
  }
  return true;
}

ros::Time EurocPlayerRos::publishedStamp(int64_t recorded_ns, int64_t lap_shift_ns)
{
  const int64_t due_ns = recorded_ns + lap_shift_ns;
  if (options_.stamp_at_handover && due_ns != handover_due_ns_)
  {
    handover_due_ns_ = due_ns;
    stamp_offset_ns_ = static_cast<int64_t>(ros::WallTime::now().toNSec()) - due_ns;
  }
  return toTime(options_.keep_stamps ? recorded_ns : due_ns + stamp_offset_ns_);
}

void EurocPlayerRos::publishItem(const TimelineItem& item, int64_t lap_shift_ns)
{
  const ros::Time stamp = publishedStamp(item.stamp_ns, lap_shift_ns);
  const int64_t due_ns = pacer_.dueTime(item.stamp_ns + lap_shift_ns);
  const auto publish = [&](ros::Publisher& publisher, const auto& message)
  {
    const int64_t lateness_ns = monotonicNow() - due_ns;
    publisher.publish(message);
    status_.count(publisher, lateness_ns);
  };
  switch (item.stream)
  {
    case Stream::IMU:
      publish(imu_, messages_.imu(item.index, stamp));
      break;
    case Stream::GROUND_TRUTH:
    {
      const nav_msgs::Odometry odometry = messages_.groundTruth(item.index, stamp);
      publish(odometry_, odometry);
      if (options_.publish_tf)
      {
        tf2_msgs::TFMessage transforms;
        transforms.transforms.push_back(EurocMessages::baseTransform(odometry));
        tf_.publish(transforms);
      }
      const auto& position = odometry.pose.pose.position;
      const bool moved = [&]
      {
        if (path_message_.poses.empty())
        {
          return true;
        }
        const auto& last = path_message_.poses.back().pose.position;
        return std::hypot(position.x - last.x, position.y - last.y, position.z - last.z) >= options_.path_spacing_m;
      }();
      if (lap_shift_ns == 0 && moved)
      {
        geometry_msgs::PoseStamped pose;
        pose.header = odometry.header;
        pose.pose = odometry.pose.pose;
        path_message_.poses.push_back(pose);
        path_message_.header.stamp = stamp;
        if (item.stamp_ns - path_published_ns_ >= PATH_PERIOD_NS)
        {
          path_published_ns_ = item.stamp_ns;
          path_.publish(path_message_);
        }
      }
      break;
    }
    case Stream::LEFT:
    case Stream::RIGHT:
    {
      const bool left = item.stream == Stream::LEFT;
      std::optional<Frame> frame = (left ? left_frames_ : right_frames_)->next();
      if (!frame)
      {
        throw std::logic_error("the picture reader ended before the time line");
      }
      if (!frame->error.empty())
      {
        status_.skip(frame->error);
        break;
      }
      const ImagePublisher& publisher = left ? left_image_ : right_image_;
      auto image = publisher.borrow();
      messages_.image(left, *frame, stamp, image.get());
      const int64_t lateness_ns = monotonicNow() - due_ns;
      publisher.publish(std::move(image));
      status_.count(publisher.rosPublisher(), lateness_ns);
      publish(left ? left_info_ : right_info_, messages_.cameraInfo(left, stamp));
      break;
    }
  }
}

}  // namespace pi_bringup
