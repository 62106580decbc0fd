// A plain roscpp node that publishes real camera images and judges those it receives: the bridge may compress them on
// the way. Steered as test_peer.cpp is: commands on stdin, answers as lines of JSON behind '@' on stdout.
//
//   verb key=value key=value ...        ->  @{"reply":"verb","ok":true,...}
//
// The node ends at "exit", at the end of stdin (the judge died) and at a signal.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include "peers/peer_verbs.h"

namespace
{
using Clock = std::chrono::steady_clock;

constexpr uint32_t STAMP_NSEC = 123456789;
const char* const FRAME_ID = "camera_optical";

/// Bytes of one pixel of the encodings that are sent here.
const std::map<std::string, uint32_t> PIXEL_BYTES = {{"rgb8", 3},   {"bgr8", 3},  {"mono8", 1},
                                                     {"mono16", 2}, {"32FC1", 4}, {"bayer_rggb8", 1}};

/// A slow ramp up and down: smooth, so that JPEG keeps it well, different in each image, row, column and channel.
uint8_t ramp(uint32_t position)
{
  const uint32_t phase = position / 4 % 510;
  return static_cast<uint8_t>(phase < 255 ? phase : 510 - phase);
}

/// The image with a number is a function of number, encoding and size, so a receiver judges it without a copy.
sensor_msgs::Image makeImage(uint32_t number, const std::string& encoding, uint32_t width, uint32_t height)
{
  const auto pixel_bytes = PIXEL_BYTES.find(encoding);
  if (pixel_bytes == PIXEL_BYTES.end())
  {
    throw std::invalid_argument("encoding=" + encoding + ": this node has no such images");
  }
  sensor_msgs::Image image;
  image.header.frame_id = FRAME_ID;
  image.header.stamp = ros::Time(number, STAMP_NSEC);  // the number travels here: roscpp overwrites header.seq
  image.encoding = encoding;
  image.width = width;
  image.height = height;
  image.step = width * pixel_bytes->second;
  image.data.resize(size_t{image.step} * height);
  for (uint32_t y = 0; y < height; ++y)
  {
    uint8_t* const row = image.data.data() + size_t{y} * image.step;
    for (uint32_t x = 0; x < image.step; ++x)
    {
      const uint32_t column = x / pixel_bytes->second;
      const uint32_t channel = x % pixel_bytes->second;
      row[x] = ramp(8 * column * (channel + 1) + 4 * y + 40 * number + 600 * channel);
    }
  }
  return image;
}

uint32_t whole(const Command& c, const std::string& key, uint32_t fallback)
{
  return c.has(key) ? static_cast<uint32_t>(std::stoul(c.text(key))) : fallback;
}

// --------------------------------------------------------------------------------------------------------------- node

class ImagePeer
{
public:
  ~ImagePeer() { stop(); }

  static const Verbs<ImagePeer> VERBS;

private:
  bool advertise(const Command& c, JsonObject*)
  {
    publisher_ = node_.advertise<sensor_msgs::Image>(c.text("topic"), whole(c, "queue", 100));
    return static_cast<bool>(publisher_);
  }
  bool subscribe(const Command& c, JsonObject*)
  {
    subscriber_ = node_.subscribe(c.text("topic"), whole(c, "queue", 100), &ImagePeer::receive, this);
    return static_cast<bool>(subscriber_);
  }

  /// count=0: in the background, until "stop".
  bool publish(const Command& c, JsonObject* out)
  {
    stop();
    const std::string encoding = c.text("encoding");
    const uint32_t width = whole(c, "width", 640);
    const uint32_t height = whole(c, "height", 480);
    const uint32_t count = whole(c, "count", 1);
    const auto interval = std::chrono::duration_cast<Clock::duration>(
        std::chrono::duration<double>(1.0 / std::max(c.real("rate", 20), 1e-3)));
    makeImage(0, encoding, width, height);  // throws here, not in the thread, if it cannot be made
    stopped_ = false;
    thread_ = std::thread(
        [=]()
        {
          auto due = Clock::now();
          for (uint32_t sent = 0; !stopped_ && ros::ok() && (count == 0 || sent < count); ++sent, due += interval)
          {
            const sensor_msgs::Image image = makeImage(published_ + 1, encoding, width, height);
            std::this_thread::sleep_until(due);
            publisher_.publish(image);
            ++published_;
          }
        });
    if (count != 0)
    {
      thread_.join();
    }
    return describePublisher(c, out);
  }
  bool stopPublishing(const Command& c, JsonObject* out)
  {
    stop();
    return describePublisher(c, out);
  }
  bool describePublisher(const Command&, JsonObject* out)
  {
    out->number("published", published_.load());
    return true;
  }

  void stop()
  {
    stopped_ = true;
    if (thread_.joinable())
    {
      thread_.join();
    }
  }

  bool awaitSubscribers(const Command& c, JsonObject* out)
  {
    const uint32_t wanted = whole(c, "n", 1);
    const bool reached = awaitState(c.deadline(), [&] { return publisher_.getNumSubscribers() == wanted; });
    out->number("subscribers", publisher_.getNumSubscribers());
    return reached;
  }

  bool awaitReceived(const Command& c, JsonObject* out)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const uint32_t number = whole(c, "seq", 0);
    const bool come = changed_.wait_until(lock, c.deadline(), [&]() { return highest_ >= number; });
    describe(out);
    return come;
  }
  bool report(const Command&, JsonObject* out)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    describe(out);
    return true;
  }

  void receive(const sensor_msgs::Image::ConstPtr& image)
  {
    const uint32_t number = image->header.stamp.sec;
    const bool known = PIXEL_BYTES.count(image->encoding) != 0 && image->width <= 10000 && image->height <= 10000;
    const sensor_msgs::Image expected =
        known ? makeImage(number, image->encoding, image->width, image->height) : sensor_msgs::Image();
    const bool fits = known && image->header.frame_id == FRAME_ID && image->header.stamp.nsec == STAMP_NSEC &&
                      image->is_bigendian == expected.is_bigendian && image->step == expected.step &&
                      image->data.size() == expected.data.size();
    const bool exact = fits && image->data == expected.data;
    uint64_t difference = 0;
    for (size_t i = 0; fits && !exact && i < expected.data.size(); ++i)
    {
      difference += static_cast<uint64_t>(std::abs(int{image->data[i]} - int{expected.data[i]}));
    }
    std::lock_guard<std::mutex> lock(mutex_);
    ++received_;
    exact_ += exact ? 1 : 0;
    malformed_ += fits ? 0 : 1;
    reordered_ += number <= highest_ ? 1 : 0;
    first_ = first_ == 0 ? number : first_;
    highest_ = std::max(highest_, number);
    worst_error_ =
        fits && !exact
            ? std::max(worst_error_, static_cast<double>(difference) / static_cast<double>(expected.data.size()))
            : worst_error_;
    forms_.insert(image->encoding + " " + std::to_string(image->width) + "x" + std::to_string(image->height));
    changed_.notify_all();
  }

  /// With mutex_ held. malformed: header, size or length is not what was sent; worst_error: largest mean difference of
  /// a byte in one image.
  void describe(JsonObject* out) const
  {
    out->number("received", received_).number("exact", exact_).number("malformed", malformed_);
    out->number("reordered", reordered_).number("first", first_).number("highest", highest_);
    out->number("worst_error", worst_error_).raw("forms", jsonArray(forms_, quoted));
  }

  ros::NodeHandle node_;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
  std::atomic<uint32_t> published_{0};  ///< number of the newest image
  std::atomic<bool> stopped_{true};
  std::thread thread_;

  std::mutex mutex_;
  std::condition_variable changed_;
  uint64_t received_ = 0;
  uint64_t exact_ = 0;
  uint64_t malformed_ = 0;
  uint64_t reordered_ = 0;
  uint32_t first_ = 0;
  uint32_t highest_ = 0;
  double worst_error_ = 0.0;
  std::set<std::string> forms_;
};

const Verbs<ImagePeer> ImagePeer::VERBS = {
    {"advertise", &ImagePeer::advertise},
    {"subscribe", &ImagePeer::subscribe},
    {"publish", &ImagePeer::publish},
    {"stop", &ImagePeer::stopPublishing},
    {"publisher", &ImagePeer::describePublisher},
    {"await_subscribers", &ImagePeer::awaitSubscribers},
    {"await_received", &ImagePeer::awaitReceived},
    {"report", &ImagePeer::report},
};
}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "test_image_peer");
  ImagePeer peer;
  ros::AsyncSpinner spinner(1);
  spinner.start();
  serveCommands(ros::this_node::getName(), ImagePeer::VERBS, &peer, ros::ok);
  ros::shutdown();
  return 0;
}
