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
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <ros/ros.h>
#include <sensor_msgs/Image.h>

namespace
{
using Clock = std::chrono::steady_clock;

constexpr uint32_t STAMP_NSEC = 123456789;
const char* const FRAME_ID = "camera_optical";
constexpr auto POLL_INTERVAL = std::chrono::milliseconds(5);  ///< the number of subscribers is signalled by no event

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

// ----------------------------------------------------------------------------------------------------------- commands

class Command
{
public:
  explicit Command(const std::string& line)
  {
    std::istringstream in(line);
    in >> verb_;
    for (std::string token; in >> token;)
    {
      const size_t equal = token.find('=');
      if (equal == std::string::npos)
      {
        throw std::invalid_argument("argument \"" + token + "\" of " + verb_ + " is not key=value");
      }
      values_[token.substr(0, equal)] = token.substr(equal + 1);
    }
  }
  const std::string& verb() const { return verb_; }
  std::string text(const std::string& key) const
  {
    const auto it = values_.find(key);
    if (it == values_.end())
    {
      throw std::invalid_argument(verb_ + " needs " + key + "=");
    }
    return it->second;
  }
  double real(const std::string& key, double fallback) const
  {
    return values_.count(key) != 0 ? std::stod(text(key)) : fallback;
  }
  uint32_t whole(const std::string& key, uint32_t fallback) const
  {
    return values_.count(key) != 0 ? static_cast<uint32_t>(std::stoul(text(key))) : fallback;
  }
  Clock::time_point deadline() const
  {
    return Clock::now() +
           std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(real("timeout", 30)));
  }

private:
  std::string verb_;
  std::map<std::string, std::string> values_;
};

std::string field(const std::string& key, const std::string& json)
{
  return ",\"" + key + "\":" + json;
}

std::string quoted(const std::string& text)
{
  std::string out = "\"";
  for (const char c : text)
  {
    if (c == '"' || c == '\\')
    {
      out += '\\';
    }
    out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return out + "\"";
}

// --------------------------------------------------------------------------------------------------------------- node

class ImagePeer
{
public:
  ~ImagePeer() { stop(); }

  /// Executes a command. @return the fields of the answer. @throws std::exception if it fails.
  std::string execute(const Command& c)
  {
    if (c.verb() == "advertise")
    {
      publisher_ = node_.advertise<sensor_msgs::Image>(c.text("topic"), c.whole("queue", 100));
      return "";
    }
    if (c.verb() == "subscribe")
    {
      subscriber_ = node_.subscribe(c.text("topic"), c.whole("queue", 100), &ImagePeer::receive, this);
      return "";
    }
    if (c.verb() == "publish")
    {
      publish(c);
      return field("published", std::to_string(published_.load()));
    }
    if (c.verb() == "stop")
    {
      stop();
      return field("published", std::to_string(published_.load()));
    }
    if (c.verb() == "publisher")
    {
      return field("published", std::to_string(published_.load()));
    }
    if (c.verb() == "await_subscribers")
    {
      return awaitSubscribers(c);
    }
    if (c.verb() == "await_received")
    {
      return awaitReceived(c);
    }
    if (c.verb() == "report")
    {
      std::lock_guard<std::mutex> lock(mutex_);
      return report();
    }
    throw std::invalid_argument("unknown verb \"" + c.verb() + "\"");
  }

private:
  /// count=0: in the background, until "stop".
  void publish(const Command& c)
  {
    stop();
    const std::string encoding = c.text("encoding");
    const uint32_t width = c.whole("width", 640);
    const uint32_t height = c.whole("height", 480);
    const uint32_t count = c.whole("count", 1);
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
  }

  void stop()
  {
    stopped_ = true;
    if (thread_.joinable())
    {
      thread_.join();
    }
  }

  std::string awaitSubscribers(const Command& c)
  {
    const Clock::time_point deadline = c.deadline();
    while (publisher_.getNumSubscribers() != c.whole("n", 1))
    {
      if (Clock::now() > deadline)
      {
        throw std::runtime_error("there are " + std::to_string(publisher_.getNumSubscribers()) + " subscribers");
      }
      std::this_thread::sleep_for(POLL_INTERVAL);
    }
    return "";
  }

  std::string awaitReceived(const Command& c)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const uint32_t number = c.whole("seq", 0);
    if (!changed_.wait_until(lock, c.deadline(), [&]() { return highest_ >= number; }))
    {
      throw std::runtime_error("no image " + std::to_string(number) + report());
    }
    return report();
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
  std::string report() const
  {
    std::string forms;
    for (const std::string& form : forms_)
    {
      forms += (forms.empty() ? "" : ",") + quoted(form);
    }
    return field("received", std::to_string(received_)) + field("exact", std::to_string(exact_)) +
           field("malformed", std::to_string(malformed_)) + field("reordered", std::to_string(reordered_)) +
           field("first", std::to_string(first_)) + field("highest", std::to_string(highest_)) +
           field("worst_error", std::to_string(worst_error_)) + field("forms", "[" + forms + "]");
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

void answer(const std::string& verb, bool ok, const std::string& fields)
{
  const std::string line = "@{\"reply\":" + quoted(verb) + ",\"ok\":" + (ok ? "true" : "false") + fields + "}\n";
  std::fwrite(line.data(), 1, line.size(), stdout);
  std::fflush(stdout);
}
}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "test_image_peer");
  ImagePeer peer;
  ros::AsyncSpinner spinner(1);
  spinner.start();
  answer("ready", true, field("name", quoted(ros::this_node::getName())));
  for (std::string line; ros::ok() && std::getline(std::cin, line) && line != "exit";)
  {
    try
    {
      const Command command(line);
      answer(command.verb(), true, peer.execute(command));
    }
    catch (const std::exception& error)
    {
      answer(line, false, field("error", quoted(error.what())));
    }
  }
  ros::shutdown();
  return 0;
}
