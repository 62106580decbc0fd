#include <pi_bringup/ros/conversions.h>
#include <pi_bringup/ros/parameters.h>
#include <pi_bringup/ros/video_player_ros.h>

#include <cmath>
#include <stdexcept>
#include <utility>

namespace pi_bringup
{

void VideoPlayerOptions::validate() const
{
  checkOption(!file.empty(), "file", "\"\"", "a video file");
  checkOption(rate > 0.0 && rate <= 1000.0, "rate", std::to_string(rate), "in (0, 1000]");
  checkOption(duration_s >= 0.0, "duration_s", std::to_string(duration_s), "0 (all) or more");
  checkOption(frame_rate_hz >= 0.0 && frame_rate_hz <= 1000.0, "frame_rate_hz", std::to_string(frame_rate_hz),
              "in [0, 1000], 0 for the rate in the file");
  checkOption(horizontal_fov_deg > 0.0 && horizontal_fov_deg < 180.0, "horizontal_fov_deg",
              std::to_string(horizontal_fov_deg), "in (0, 180)");
  checkOption(!left_frame.empty(), "left_frame", "\"\"", "a frame name");
  checkOption(queue_size >= 1, "queue_size", std::to_string(queue_size), "1 or more (0 would be unbounded in roscpp)");
  checkOption(prefetch_depth >= 1 && prefetch_depth <= 1000, "prefetch_depth", std::to_string(prefetch_depth),
              "in [1, 1000]");
}

VideoPlayerOptions VideoPlayerOptions::load(const ros::NodeHandle& node)
{
  VideoPlayerOptions options;
  loadParameter(node, "file", &options.file);
  loadParameter(node, "rate", &options.rate);
  loadParameter(node, "loop", &options.loop);
  loadParameter(node, "duration_s", &options.duration_s);
  loadParameter(node, "frame_rate_hz", &options.frame_rate_hz);
  loadParameter(node, "horizontal_fov_deg", &options.horizontal_fov_deg);
  loadParameter(node, "left_frame", &options.left_frame);
  loadParameter(node, "stamp_at_handover", &options.stamp_at_handover);
  loadParameter(node, "queue_size", &options.queue_size);
  loadParameter(node, "prefetch_depth", &options.prefetch_depth);
  loadParameter(node, "exit_when_done", &options.exit_when_done);
  loadParameter(node, "wait_for_subscribers", &options.wait_for_subscribers);
  options.validate();
  return options;
}

VideoPlayerRos::VideoPlayerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : node_(std::move(node))
  , options_(VideoPlayerOptions::load(private_node))
  , reader_(options_.file, options_.loop)
  , frame_rate_hz_(options_.frame_rate_hz > 0.0 ? options_.frame_rate_hz : reader_.frameRate())
  , pacer_(options_.rate)
  , status_(private_node, "video_player")
{
  if (!(frame_rate_hz_ > 0.0))
  {
    throw std::invalid_argument("video " + options_.file + " has no frame rate; set the parameter frame_rate_hz");
  }
  const auto queue_size = static_cast<uint32_t>(options_.queue_size);
  image_ = pi_os_transport::zero_copy::Publisher<sensor_msgs::Image>(
      gate_.advertise<sensor_msgs::Image>(node_, "left/image_raw", queue_size));
  info_ = gate_.advertise<sensor_msgs::CameraInfo>(node_, "left/camera_info", queue_size);
  gate_.require(options_.wait_for_subscribers);
  info_message_ = nominalCameraInfo(reader_.width(), reader_.height(), options_.horizontal_fov_deg * M_PI / 180.0);
  info_message_.header.frame_id = options_.left_frame;
  ROS_INFO_STREAM_NAMED("playback", options_.file << ": " << reader_.width() << "x" << reader_.height() << " at "
                                                  << frame_rate_hz_ << " Hz, rate " << options_.rate
                                                  << (options_.loop ? ", looped" : "")
                                                  << "; camera_info is nominal, not calibrated");
}

VideoPlayerRos::~VideoPlayerRos()
{
  stop();
}

void VideoPlayerRos::stop()
{
  gate_.stop();
  pacer_.stop();
}

void VideoPlayerRos::play()
{
  FramePrefetcher frames([this] { return reader_.next(); }, static_cast<size_t>(options_.prefetch_depth));
  status_.waiting();
  if (gate_.wait())
  {
    status_.playing();
    pacer_.start(0, monotonicNow());
    const auto wall_start_ns = static_cast<int64_t>(ros::WallTime::now().toNSec());
    for (int64_t index = 0;; ++index)
    {
      const double film_s = static_cast<double>(index) / frame_rate_hz_;
      if (options_.duration_s > 0.0 && film_s >= options_.duration_s)
      {
        break;
      }
      std::optional<Frame> frame = frames.next();
      const int64_t film_ns = std::llround(film_s * 1e9);
      if (!frame || !pacer_.waitUntil(film_ns))
      {
        break;
      }
      if (!frame->error.empty())
      {
        status_.skip(frame->error);
        continue;
      }
      const int64_t due_ns = pacer_.dueTime(film_ns);
      const ros::Time stamp = toTime(options_.stamp_at_handover ? static_cast<int64_t>(ros::WallTime::now().toNSec())
                                                                : wall_start_ns + (due_ns - pacer_.dueTime(0)));
      info_message_.header.stamp = stamp;
      auto image = image_.borrow();
      toImage(*frame, stamp, options_.left_frame, image.get());
      const int64_t image_lateness_ns = monotonicNow() - due_ns;
      image_.publish(std::move(image));
      status_.count(image_.rosPublisher(), image_lateness_ns);
      const int64_t info_lateness_ns = monotonicNow() - due_ns;
      info_.publish(info_message_);
      status_.count(info_, info_lateness_ns);
    }
  }
  frames.stop();
  status_.finished();
}

}  // namespace pi_bringup
