#include <fcntl.h>
#include <pi_bringup/frame_prefetcher.h>
#include <pi_bringup/ros/euroc_bag_writer.h>
#include <rosbag/bag.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <boost/make_shared.hpp>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace pi_bringup
{

namespace
{

namespace fs = std::filesystem;

/// Removes the partial file unless it was given its final name.
class PartialFile
{
public:
  explicit PartialFile(const fs::path& final_path)
    : final_path_(fs::absolute(final_path)), path_(final_path_.string() + ".part")
  {
    // rosbag reports a failed fopen without its reason, so the reason is found here.
    const int descriptor = open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor < 0)
    {
      const int reason = errno;
      throw std::runtime_error(
          path_.string() + ": cannot be created: " + std::strerror(reason) +
          (reason == EEXIST ? "; another run writes it or was killed, remove it if not running" : ""));
    }
    close(descriptor);
  }
  ~PartialFile()
  {
    if (!kept_)
    {
      std::error_code ignored;
      fs::remove(path_, ignored);
    }
  }
  PartialFile(const PartialFile&) = delete;
  PartialFile& operator=(const PartialFile&) = delete;

  const fs::path& path() const { return path_; }

  void keep()
  {
    fs::rename(path_, final_path_);
    kept_ = true;
  }

private:
  const fs::path final_path_;
  const fs::path path_;
  bool kept_ = false;
};

/// A bag for writing that survives a full disk: the destructor of rosbag::Bag closes the file and, when that fails,
/// takes the process along.
class WritableBag
{
public:
  WritableBag(const fs::path& path, rosbag::CompressionType compression)
    : path_(path), bag_(std::make_unique<rosbag::Bag>())
  {
    guarded(
        [&]
        {
          bag_->open(path.string(), rosbag::bagmode::Write);
          bag_->setCompression(compression);
        });
  }

  ~WritableBag()
  {
    try
    {
      close();
    }
    catch (const std::runtime_error&)
    {
      // Another error is on its way, or the caller had it: close() belongs to the normal course.
    }
  }
  WritableBag(const WritableBag&) = delete;
  WritableBag& operator=(const WritableBag&) = delete;

  template <typename... Arguments>
  void write(const Arguments&... arguments)
  {
    guarded([&] { bag_->write(arguments...); });
  }

  void close()
  {
    if (bag_)
    {
      guarded([&] { bag_->close(); });
    }
  }

private:
  template <typename Action>
  void guarded(const Action& action)
  {
    try
    {
      action();
    }
    catch (const rosbag::BagException& exception)
    {
      bag_.release();  // abandoned with its file descriptor, see above
      std::error_code ignored;
      throw std::runtime_error(path_.string() + ": cannot be written: " + exception.what() + "; " +
                               std::to_string(fs::space(path_.parent_path(), ignored).available) +
                               " bytes are free there");
    }
  }

  const fs::path path_;
  std::unique_ptr<rosbag::Bag> bag_;
};

rosbag::CompressionType compressionType(const std::string& name)
{
  return name == "lz4"   ? rosbag::compression::LZ4
         : name == "bz2" ? rosbag::compression::BZ2
                         : rosbag::compression::Uncompressed;
}

}  // namespace

void BagWriterOptions::validate() const
{
  if (topic_prefix.empty() || topic_prefix.front() != '/' || topic_prefix.back() != '/')
  {
    throw std::invalid_argument("namespace = \"" + topic_prefix + "\", must begin with /");
  }
  if (compression != "none" && compression != "lz4" && compression != "bz2")
  {
    throw std::invalid_argument("compression = \"" + compression + "\", must be none, lz4 or bz2");
  }
  frames.validate();
}

BagWriterResult writeBag(const EurocDataset& dataset, const std::string& bag_path, const BagWriterOptions& options,
                         const std::function<bool(size_t, size_t)>& go_on)
{
  options.validate();
  if (fs::exists(bag_path) && !options.overwrite)
  {
    throw std::invalid_argument(bag_path + " exists; name another file or use --force to replace it");
  }
  const EurocMessages messages(dataset, options.frames);
  const Timeline timeline = Timeline::build(dataset, options.timeline);

  BagWriterResult result;
  PartialFile partial(bag_path);
  WritableBag bag(partial.path(), compressionType(options.compression));

  std::map<std::string, uint32_t> next_seq;  // the publisher numbers messages on the wire; a bag has none
  const auto write = [&](const std::string& topic, const ros::Time& stamp, auto& message)
  {
    const std::string name = options.topic_prefix + topic;
    message.header.seq = next_seq[name]++;
    bag.write(name, stamp, message);
    ++result.written[name];
  };

  const ros::Time start = toTime(timeline.items.front().stamp_ns);
  auto latched = boost::make_shared<ros::M_string>();  // a header given by the caller must be whole
  (*latched)["type"] = ros::message_traits::datatype<tf2_msgs::TFMessage>();
  (*latched)["md5sum"] = ros::message_traits::md5sum<tf2_msgs::TFMessage>();
  (*latched)["message_definition"] = ros::message_traits::definition<tf2_msgs::TFMessage>();
  (*latched)["latching"] = "1";
  (*latched)["callerid"] = "/euroc_to_bag";
  bag.write("/tf_static", start, messages.staticTransforms(start), latched);
  ++result.written["/tf_static"];

  size_t done = 0;
  for (const TimelineItem& item : timeline.items)
  {
    if (!go_on(done, timeline.items.size()))
    {
      bag.close();
      return result;
    }
    const ros::Time stamp = toTime(item.stamp_ns);
    switch (item.stream)
    {
      case Stream::IMU:
      {
        sensor_msgs::Imu imu = messages.imu(item.index, stamp);
        write("imu/data", stamp, imu);
        break;
      }
      case Stream::GROUND_TRUTH:
      {
        nav_msgs::Odometry odometry = messages.groundTruth(item.index, stamp);
        write("ground_truth/odometry", stamp, odometry);
        break;
      }
      case Stream::LEFT:
      case Stream::RIGHT:
      {
        const bool left = item.stream == Stream::LEFT;
        const Camera& camera = left ? dataset.left : *dataset.right;
        Frame frame =
            decodeGreyImage(camera.images[item.index].path, camera.calibration.width, camera.calibration.height);
        if (!frame.error.empty())
        {
          result.first_skip_reason = result.skipped_pictures == 0 ? frame.error : result.first_skip_reason;
          ++result.skipped_pictures;
          break;
        }
        const std::string side = left ? "left" : "right";
        const sensor_msgs::ImagePtr image = messages.image(left, std::move(frame), stamp);
        write(side + "/image_raw", stamp, *image);
        sensor_msgs::CameraInfo info = messages.cameraInfo(left, stamp);
        write(side + "/camera_info", stamp, info);
        break;
      }
    }
    ++done;
  }
  bag.close();
  // The last word: a stop during the last message still counts.
  if (go_on(done, timeline.items.size()))
  {
    partial.keep();
    result.complete = true;
  }
  return result;
}

}  // namespace pi_bringup
