#include "ros/player_ros.h"
#include <pi_node/ros/node_options.h>
#include <pi_speech/ros/audio_conversions.h>
#include <pthread.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>
#include "audio/sound_files.h"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <exception>
#include <random>
#include <stdexcept>
#include <utility>

namespace pi_speech
{
namespace
{

constexpr uint32_t PLAYED_QUEUE = 1000;  ///< messages that wait for a subscriber: fast playing comes in bursts

PlayerRosOptions loadOptions(const ros::NodeHandle& private_node)
{
  PlayerRosOptions options = pi_node::loadNodeOptions<PlayerRosOptions>(private_node, "player");
  if (options.files.entries.empty())
  {
    throw std::invalid_argument("parameter " + private_node.resolveName("files") +
                                " is empty, must name what to play: sound files, a folder, or a list (.txt, .tsv)");
  }
  return options;
}

std::chrono::steady_clock::duration seconds(double s)
{
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(s));
}

}  // namespace

PlayerRos::PlayerRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : links_thread_("player_links")
  , links_node_(links_thread_.handle(node))
  , options_(loadOptions(private_node))
  , files_(listSoundFiles(options_.files.entries))
{
  makeGap();
  info_ = pi_node::LatchedPublisher<AudioInfo>(links_node_, "audio_info", 1);
  playing_ = links_node_.advertise<std_msgs::String>("playing", 10, true);
  finished_ = links_node_.advertise<std_msgs::Empty>("finished", 1, true);
  audio_ = links_node_.advertise<AudioDataStamped>("audio_stamped", PLAYED_QUEUE,
                                                   [this](const ros::SingleSubscriberPublisher&)
                                                   {
                                                     std::lock_guard<std::mutex> lock(mutex_);
                                                     subscribed_ = true;
                                                     changed_.notify_all();
                                                   });
  info_.publish(toMsg(AudioFormat()));
  thread_ = std::thread(
      [this]
      {
        pthread_setname_np(pthread_self(), "player");
        play();
      });
  links_thread_.start();
}

PlayerRos::~PlayerRos()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
  }
  thread_.join();
  links_thread_.stop();
}

void PlayerRos::makeGap()
{
  gap_.resize(static_cast<size_t>(std::llround(options_.gap_s * SAMPLE_RATE_HZ)));
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0.0, 32768.0 * std::pow(10.0, options_.gap_level_dbfs / 20.0));
  std::generate(gap_.begin(), gap_.end(),
                [&] { return static_cast<int16_t>(std::lround(std::clamp(noise(random), -32768.0, 32767.0))); });
}

// ------------------------------------------------------------------------------------------------------------- player

void PlayerRos::play()
{
  if (!waitForSubscriber() || !waitForTime())
  {
    return;
  }
  begin_ = Clock::now();
  begin_stamp_ = ros::Time::now();
  do
  {
    if (!playRound())
    {
      break;
    }
  } while (options_.loop);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_)
    {
      return;
    }
  }
  if (played_ == 0)
  {
    ROS_ERROR_STREAM_NAMED("player", "nothing was played: none of the " << files_.size() << " files can be read");
  }
  else
  {
    ROS_INFO_STREAM_NAMED("player", "played " << played_ << " of " << files_.size() << " files, "
                                              << static_cast<double>(sent_) / SAMPLE_RATE_HZ << " s of sound");
  }
  finished_.publish(std_msgs::Empty());
}

bool PlayerRos::waitForSubscriber()
{
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait(lock, [this] { return stopping_ || subscribed_ || !options_.start_when_subscribed; });
  return !stopping_;
}

bool PlayerRos::waitForTime()
{
  while (!ros::Time::waitForValid(ros::WallDuration(0.1)))  // simulated, and its clock has not begun
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_)
    {
      return false;
    }
  }
  return true;
}

std::future<PlayerRos::File> PlayerRos::read(const std::string& path) const
{
  return std::async(std::launch::async,
                    [path]
                    {
                      pthread_setname_np(pthread_self(), "player_reader");
                      File file;
                      file.path = path;
                      try
                      {
                        file.samples = readAudioFile(path);
                      }
                      catch (const std::exception& error)
                      {
                        file.problem = error.what();
                      }
                      return file;
                    });
}

bool PlayerRos::playRound()
{
  const uint64_t played_before = played_;
  std::future<File> next = read(files_.front());
  for (size_t i = 0; i < files_.size(); ++i)
  {
    const File file = next.get();
    if (i + 1 < files_.size())
    {
      next = read(files_[i + 1]);
    }
    if (!file.problem.empty())
    {
      if (unreadable_.insert(file.path).second)
      {
        ROS_ERROR_STREAM_NAMED("player", file.problem << "; the next one is played");
      }
      continue;
    }
    if (!playFile(file))
    {
      return false;
    }
  }
  return (message_.empty() || send()) && played_ > played_before;
}

bool PlayerRos::playFile(const File& file)
{
  std_msgs::String name;
  name.data = file.path;
  playing_.publish(name);
  ++played_;
  return add(file.samples) && add(gap_);
}

bool PlayerRos::add(const Samples& samples)
{
  const auto full = static_cast<size_t>(std::max(1L, std::lround(options_.period_s * SAMPLE_RATE_HZ)));
  for (auto begin = samples.begin(); begin != samples.end();)
  {
    const auto count = std::min(samples.end() - begin, static_cast<std::ptrdiff_t>(full - message_.size()));
    message_.insert(message_.end(), begin, begin + count);
    begin += count;
    if (message_.size() == full && !send())
    {
      return false;
    }
  }
  return true;
}

bool PlayerRos::send()
{
  const auto time_of = [](uint64_t samples) { return static_cast<double>(samples) / SAMPLE_RATE_HZ; };
  const Clock::time_point due = begin_ + seconds(time_of(sent_ + message_.size()) / options_.rate);
  {
    std::unique_lock<std::mutex> lock(mutex_);
    if (changed_.wait_until(lock, due, [this] { return stopping_; }))
    {
      return false;
    }
  }
  std_msgs::Header header;
  header.stamp = begin_stamp_ + ros::Duration().fromNSec(static_cast<int64_t>(sent_ * 1000000000 / SAMPLE_RATE_HZ));
  header.frame_id = options_.frame_id;
  audio_.publish(boost::make_shared<const AudioDataStamped>(toMsg(message_.data(), message_.size(), header)));
  sent_ += message_.size();
  message_.clear();
  return true;
}

}  // namespace pi_speech
