#include "evaluation/bag_reader.h"

#include <cv_bridge/cv_bridge.h>
#include <geometry_msgs/TwistStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/ros/time.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/algorithm/string.hpp>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <utility>
#include <vector>

#include "ros/conversions.h"

namespace pi_slam
{

namespace
{

/// A stream may lag behind the others by this much.
constexpr int64_t MAX_LATE_NS = 1000000000;
/// Between stamps and the times of reception, beyond the difference at the first picture: where reading begins.
constexpr int64_t VIEW_MARGIN_NS = 2 * MAX_LATE_NS;

const std::string IMAGE_TYPE = "sensor_msgs/Image";
const std::string COMPRESSED_TYPE = "sensor_msgs/CompressedImage";
const std::string IMU_TYPE = "sensor_msgs/Imu";

/// The three streams of a recording.
enum Stream
{
  LEFT_PICTURES,
  RIGHT_PICTURES,
  IMU_SAMPLES,
  STREAMS,
};

/// A view begins after 0.
ros::Time viewTime(int64_t stamp_ns)
{
  return pi_node::toTime(std::max<int64_t>(stamp_ns, 1));
}

bool isPicture(const std::string& type)
{
  return type == IMAGE_TYPE || type == COMPRESSED_TYPE;
}

bool endsWith(const std::string& topic, const std::string& name)
{
  return topic == name || boost::ends_with(topic, "/" + name);
}

std::string join(const std::vector<std::string>& names)
{
  return names.empty() ? "none" : boost::join(names, ", ");
}

class BagSource : public SequenceSource
{
public:
  BagSource(const std::string& file, const BagTopics& topics, const SequenceReaderOptions& options)
    : file_(file), tolerance_ns_(static_cast<int64_t>(1e9 * options.pair_tolerance_s))
  {
    options.validate();
    try
    {
      bag_.open(file, rosbag::bagmode::Read);
    }
    catch (const rosbag::BagException& exception)
    {
      throw RecordingError(file + ": is no bag that can be read: " + exception.what());
    }
    chooseTopics(topics);
    describe(options);
  }

  std::optional<SequenceItem> next() override
  {
    while (true)
    {
      std::optional<SequenceItem> item = take();
      if (item)
      {
        return item;
      }
      if (message_ == view_->end())
      {
        if (complete_)
        {
          return std::nullopt;
        }
        complete_ = true;
        continue;
      }
      read(*message_);
      ++message_;
    }
  }

private:
  [[noreturn]] void fail(const std::string& defect) const { throw RecordingError(file_ + ": " + defect); }

  void chooseTopics(const BagTopics& topics)
  {
    rosbag::View view(bag_);
    for (const rosbag::ConnectionInfo* connection : view.getConnections())
    {
      types_[connection->topic] = connection->datatype;
    }
    topics_[LEFT_PICTURES] = choose(topics.left, "left", {"left/image_raw", "cam0/image_raw", "left/image_mono"});
    topics_[RIGHT_PICTURES] = choose(topics.right, "right", {"right/image_raw", "cam1/image_raw", "right/image_mono"});
    topics_[IMU_SAMPLES] = choose(topics.imu, "imu", {"imu/data", "imu0", "imu/data_raw", "imu"});
  }

  std::string choose(const std::string& wanted, const std::string& stream, const std::vector<std::string>& names) const
  {
    const bool pictures = stream != "imu";
    std::vector<std::string> fitting;
    for (const auto& [topic, type] : types_)
    {
      if (pictures ? isPicture(type) : type == IMU_TYPE)
      {
        fitting.push_back(topic);
      }
    }
    if (!wanted.empty())
    {
      if (std::find(fitting.begin(), fitting.end(), wanted) == fitting.end())
      {
        fail("has no topic " + wanted + (pictures ? " of pictures" : " of type sensor_msgs/Imu") +
             "; there are: " + join(fitting));
      }
      return wanted;
    }
    for (const std::string& name : names)
    {
      std::vector<std::string> found;
      for (const std::string& topic : fitting)
      {
        if (endsWith(topic, name) || endsWith(topic, name + "/compressed"))
        {
          found.push_back(topic);
        }
      }
      if (found.size() > 1)
      {
        fail("several topics may be the " + stream + " one (" + join(found) + "); say which by --" + stream + "-topic");
      }
      if (found.size() == 1)
      {
        return found.front();
      }
    }
    fail("no topic is named as the " + stream + " one (" + join(names) + "); say which of " + join(fitting) + " by --" +
         stream + "-topic");
  }

  void describe(const SequenceReaderOptions& options)
  {
    rosbag::View left(bag_, rosbag::TopicQuery(topics_[LEFT_PICTURES]));
    if (left.size() == 0 || rosbag::View(bag_, rosbag::TopicQuery(topics_[RIGHT_PICTURES])).size() == 0)
    {
      fail("has no pictures on " + topics_[left.size() == 0 ? LEFT_PICTURES : RIGHT_PICTURES]);
    }
    const rosbag::MessageInstance first = *left.begin();
    const int64_t received_later_ns = pi_node::fromMsg(first.getTime()) - pictureStamp(first);
    from_ns_ = pictureStamp(first) + static_cast<int64_t>(1e9 * options.start_s);
    to_ns_ = options.duration_s > 0.0 ? from_ns_ + static_cast<int64_t>(1e9 * options.duration_s)
                                      : std::numeric_limits<int64_t>::max() / 2;
    const auto margin_ns = static_cast<int64_t>(1e9 * IMU_MARGIN_S) + VIEW_MARGIN_NS;
    const std::vector<std::string> topics(topics_, topics_ + STREAMS);
    const ros::Time begin = viewTime(from_ns_ + received_later_ns - margin_ns);
    const ros::Time end = options.duration_s > 0.0 ? viewTime(to_ns_ + received_later_ns + margin_ns) : ros::TIME_MAX;
    view_ = std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(topics), begin, end);
    message_ = view_->begin();
    description_.name = std::filesystem::path(file_).filename().string();
    description_.first_ns = from_ns_;
    const double length_s = (left.getEndTime() - left.getBeginTime()).toSec();
    if (options.start_s > length_s)
    {
      fail("has no picture from " + std::to_string(options.start_s) + " s on; it is " + std::to_string(length_s) +
           " s long");
    }
    // By the mean rate; the exact number would need a pass over the bag.
    const double left_s = length_s - options.start_s;
    const double part = options.duration_s > 0.0 ? std::min(options.duration_s, left_s) : left_s;
    description_.pairs = length_s > 0.0 ? static_cast<size_t>(part / length_s * left.size() + 0.5) : left.size();
  }

  int64_t pictureStamp(const rosbag::MessageInstance& message) const
  {
    if (message.getDataType() == COMPRESSED_TYPE)
    {
      return pi_node::fromMsg(message.instantiate<sensor_msgs::CompressedImage>()->header.stamp);
    }
    return pi_node::fromMsg(message.instantiate<sensor_msgs::Image>()->header.stamp);
  }

  void read(const rosbag::MessageInstance& message)
  {
    try
    {
      if (message.getTopic() == topics_[IMU_SAMPLES])
      {
        readSample(*message.instantiate<sensor_msgs::Imu>());
      }
      else
      {
        readPicture(message, message.getTopic() == topics_[LEFT_PICTURES] ? LEFT_PICTURES : RIGHT_PICTURES);
      }
    }
    catch (const rosbag::BagException& exception)
    {
      fail(std::string("is damaged: ") + exception.what());
    }
  }

  /// Counts messages that come too late.
  bool inTime(Stream stream, int64_t stamp_ns)
  {
    newest_ns_[stream] = std::max(newest_ns_[stream], stamp_ns);
    if (stamp_ns < handed_out_ns_)
    {
      ++defects_.unsorted;
      return false;
    }
    return true;
  }

  void readSample(const sensor_msgs::Imu& message)
  {
    const int64_t stamp_ns = pi_node::fromMsg(message.header.stamp);
    if (!inTime(IMU_SAMPLES, stamp_ns))
    {
      return;
    }
    ImuSample sample;
    sample.stamp_ns = stamp_ns;
    sample.w = {message.angular_velocity.x, message.angular_velocity.y, message.angular_velocity.z};
    sample.f = {message.linear_acceleration.x, message.linear_acceleration.y, message.linear_acceleration.z};
    const bool again = stamp_ns == newest_sample_ns_ || !samples_.emplace(stamp_ns, sample).second;
    defects_.repeated += again ? 1 : 0;
  }

  void readPicture(const rosbag::MessageInstance& message, Stream stream)
  {
    const int64_t stamp_ns = pictureStamp(message);
    if (stamp_ns < from_ns_ || stamp_ns > to_ns_)
    {
      newest_ns_[stream] = std::max(newest_ns_[stream], stamp_ns);
      return;
    }
    if (!inTime(stream, stamp_ns))
    {
      return;
    }
    cv::Mat picture = decode(message);
    if (picture.empty())
    {
      countUnreadable(file_ + ": the picture on " + message.getTopic() + " at " + formatSeconds(stamp_ns) +
                      " s is damaged");
    }
    defects_.repeated += pictures_[stream].emplace(stamp_ns, std::move(picture)).second ? 0 : 1;
  }

  static cv::Mat decode(const rosbag::MessageInstance& message)
  {
    try
    {
      if (message.getDataType() == COMPRESSED_TYPE)
      {
        return cv::imdecode(message.instantiate<sensor_msgs::CompressedImage>()->data, cv::IMREAD_GRAYSCALE);
      }
      return cv_bridge::toCvCopy(message.instantiate<sensor_msgs::Image>(), sensor_msgs::image_encodings::MONO8)->image;
    }
    catch (const cv::Exception&)
    {
      return {};
    }
    catch (const cv_bridge::Exception&)
    {
      return {};
    }
  }

  /// True if a stream has no more messages with stamps up to this one.
  bool settled(Stream stream, int64_t stamp_ns) const
  {
    const int64_t newest_ns = std::max({newest_ns_[0], newest_ns_[1], newest_ns_[2]});
    return complete_ || newest_ns_[stream] > stamp_ns || newest_ns > stamp_ns + MAX_LATE_NS;
  }

  /// The oldest item, if nothing older can come.
  std::optional<SequenceItem> take()
  {
    const auto& left = pictures_[LEFT_PICTURES];
    const auto& right = pictures_[RIGHT_PICTURES];
    while (true)
    {
      constexpr int64_t NEVER = std::numeric_limits<int64_t>::max();
      const int64_t left_ns = left.empty() ? NEVER : left.begin()->first;
      const int64_t right_ns = right.empty() ? NEVER : right.begin()->first;
      const int64_t picture_ns = std::min(left_ns, right_ns);
      if (!samples_.empty() && samples_.begin()->first <= picture_ns)
      {
        const int64_t stamp_ns = samples_.begin()->first;
        // Pictures with its stamp come after it.
        if (!settled(LEFT_PICTURES, stamp_ns - 1) || !settled(RIGHT_PICTURES, stamp_ns - 1) ||
            !settled(IMU_SAMPLES, stamp_ns - 1))
        {
          return std::nullopt;
        }
        const ImuSample sample = samples_.begin()->second;
        samples_.erase(samples_.begin());
        if (!withinMargin(stamp_ns))
        {
          continue;
        }
        handed_out_ns_ = stamp_ns;
        newest_sample_ns_ = stamp_ns;
        return sample;
      }
      if (picture_ns == NEVER || !settled(LEFT_PICTURES, picture_ns + tolerance_ns_) ||
          !settled(RIGHT_PICTURES, picture_ns + tolerance_ns_) || !settled(IMU_SAMPLES, picture_ns))
      {
        return std::nullopt;
      }
      if (StereoPair pair = takePair(left_ns, right_ns); hasPicture(pair))
      {
        return pair;
      }
    }
  }

  StereoPair takePair(int64_t left_ns, int64_t right_ns)
  {
    StereoPair pair;
    const bool both = std::max(left_ns, right_ns) - std::min(left_ns, right_ns) <= tolerance_ns_;
    const bool use_left = both || left_ns < right_ns;
    const bool use_right = both || right_ns < left_ns;
    pair.stamp_ns = use_left ? left_ns : right_ns;
    if (use_left)
    {
      pair.left = pictures_[LEFT_PICTURES].begin()->second;
      pictures_[LEFT_PICTURES].erase(pictures_[LEFT_PICTURES].begin());
    }
    if (use_right)
    {
      pair.right = pictures_[RIGHT_PICTURES].begin()->second;
      pictures_[RIGHT_PICTURES].erase(pictures_[RIGHT_PICTURES].begin());
    }
    handed_out_ns_ = std::min(left_ns, right_ns);
    return pair;
  }

  bool withinMargin(int64_t stamp_ns) const
  {
    const auto margin_ns = static_cast<int64_t>(1e9 * IMU_MARGIN_S);
    return stamp_ns >= from_ns_ - margin_ns && stamp_ns <= to_ns_ + margin_ns;
  }

  const std::string file_;
  const int64_t tolerance_ns_;
  rosbag::Bag bag_;
  std::map<std::string, std::string> types_;  // of topics
  std::string topics_[STREAMS];
  std::unique_ptr<rosbag::View> view_;
  rosbag::View::iterator message_;
  int64_t from_ns_ = 0;  // of pictures
  int64_t to_ns_ = 0;

  std::map<int64_t, cv::Mat> pictures_[2];
  std::map<int64_t, ImuSample> samples_;
  int64_t newest_ns_[STREAMS] = {0, 0, 0};
  int64_t handed_out_ns_ = 0;     // newest item of all
  int64_t newest_sample_ns_ = 0;  // handed out
  bool complete_ = false;         // all of the bag is read
};

}  // namespace

std::unique_ptr<SequenceSource> openBag(const std::string& file, const BagTopics& topics,
                                        const SequenceReaderOptions& options)
{
  return std::make_unique<BagSource>(file, topics, options);
}

std::vector<WheelSample> readBagWheels(const std::string& file, const std::string& topic)
{
  std::vector<WheelSample> samples;
  try
  {
    rosbag::Bag bag(file);
    for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(topic)))
    {
      if (const auto odometry = message.instantiate<nav_msgs::Odometry>())
      {
        samples.push_back(toWheelSample(odometry->header.stamp, odometry->twist.twist));
      }
      else if (const auto twist = message.instantiate<geometry_msgs::TwistStamped>())
      {
        samples.push_back(toWheelSample(twist->header.stamp, twist->twist));
      }
    }
  }
  catch (const rosbag::BagException& exception)
  {
    throw RecordingError(file + ": is no bag that can be read: " + exception.what());
  }
  if (samples.empty())
  {
    throw RecordingError(file + ": has no nav_msgs/Odometry or geometry_msgs/TwistStamped on " + topic +
                         "; give the wheels' topic by --wheel-topic");
  }
  return samples;
}

}  // namespace pi_slam
