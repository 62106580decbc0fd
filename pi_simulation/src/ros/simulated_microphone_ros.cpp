#include "ros/simulated_microphone_ros.h"

#include <pi_node/durations.h>
#include <pi_node/ros/node_options.h>
#include <pi_node/vehicle_clock.h>
#include <pi_simulation/PlayedSound.h>
#include <pi_speech/ros/audio_conversions.h>
#include <pthread.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <exception>
#include <utility>

namespace pi_simulation
{
namespace
{

constexpr int64_t RATE = pi_speech::SAMPLE_RATE_HZ;
constexpr size_t MESSAGE = RATE / 50;  ///< samples
constexpr int64_t LONGEST_PAUSE_NS = 1000000000;
constexpr uint32_t QUEUE = 100;  ///< messages that wait for a subscriber: 2 s
constexpr uint32_t PLAY_QUEUE = 20;

int64_t nanosecondsOf(int64_t samples)
{
  return samples * 1000000000 / RATE;
}

}  // namespace

SimulatedMicrophoneRos::SimulatedMicrophoneRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("sim_mic_ros")
  , service_node_(service_thread_.handle(node))
  , service_private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<SimulatedMicrophoneRosOptions>(private_node, "simulated_microphone"))
  , mixer_(options_.mixer)
{
  info_ = pi_node::LatchedPublisher<pi_speech::AudioInfo>(service_node_, "audio_info", 1);
  audio_ = service_node_.advertise<pi_speech::AudioDataStamped>("audio_stamped", QUEUE);
  played_ = service_private_node_.advertise<PlayedSound>("played", PLAY_QUEUE);
  info_.publish(pi_speech::toMsg(pi_speech::AudioFormat()));
  play_ = service_private_node_.subscribe("play", PLAY_QUEUE, &SimulatedMicrophoneRos::onPlay, this);
  command_ = service_private_node_.advertiseService("command", &SimulatedMicrophoneRos::onCommand, this);
  thread_ = std::thread(
      [this]
      {
        pthread_setname_np(pthread_self(), "sim_microphone");
        run();
      });
  service_thread_.start();
}

SimulatedMicrophoneRos::~SimulatedMicrophoneRos()
{
  service_thread_.stop();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

// -------------------------------------------------------------------------------------------------------- sim_mic_ros

void SimulatedMicrophoneRos::onPlay(const std_msgs::String& message)
{
  try
  {
    Sound sound{message.data, pi_speech::readAudioFile(message.data)};
    const std::lock_guard<std::mutex> lock(mutex_);
    requests_.push_back(std::move(sound));
  }
  catch (const std::exception& error)
  {
    ROS_ERROR_STREAM_NAMED("simulated_microphone", error.what() << "; nothing is played");
  }
}

bool SimulatedMicrophoneRos::onCommand(SimulatorCommand::Request& request, SimulatorCommand::Response& response)
{
  response.message = execute(request.line);
  response.success = response.message.empty();
  if (response.success)
  {
    ROS_INFO_STREAM_NAMED("simulated_microphone", "command: " << request.line);
  }
  return true;
}

std::string SimulatedMicrophoneRos::execute(const std::string& line)
{
  if (line == "unplug" || line == "plug")
  {
    plugged_ = line == "plug";
    return "";
  }
  if (line == "silent on" || line == "silent off")
  {
    silent_ = line == "silent on";
    return "";
  }
  return "command \"" + line + "\" is not understood, must be one of: unplug, plug, silent on|off";
}

// ----------------------------------------------------------------------------------------------------- sim_microphone

void SimulatedMicrophoneRos::run()
{
  if (!waitForTime())
  {
    return;
  }
  beginStream();
  // A message begins when its first sample is recorded, and leaves with its last one.
  while (true)
  {
    beginSounds();
    const int64_t due_ns = begin_ns_ + nanosecondsOf(mixer_.position() + static_cast<int64_t>(MESSAGE) - begin_sample_);
    if (!waitUntil(due_ns))
    {
      return;
    }
    if (pi_node::vehicleNs() > due_ns + LONGEST_PAUSE_NS)
    {
      ROS_WARN_NAMED("simulated_microphone",
                     "more than 1 s late: the process was stopped, or the computer is busy; the "
                     "sound has a gap");
      beginStream();
      continue;
    }
    send();
  }
}

bool SimulatedMicrophoneRos::waitForTime()
{
  while (!ros::Time::waitForValid(ros::WallDuration(0.1)))  // simulated, and its clock has not begun
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_)
    {
      return false;
    }
  }
  return true;
}

bool SimulatedMicrophoneRos::waitUntil(int64_t due_ns)
{
  std::unique_lock<std::mutex> lock(mutex_);
  return !pi_node::waitFor(&changed_, &lock, pi_node::secondsBetween(pi_node::vehicleNs(), due_ns),
                           [this] { return stopping_; });
}

void SimulatedMicrophoneRos::beginStream()
{
  begin_ns_ = pi_node::vehicleNs();
  begin_stamp_ = ros::Time::now();
  begin_sample_ = mixer_.position();
}

void SimulatedMicrophoneRos::beginSounds()
{
  std::vector<Sound> sounds;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    sounds.swap(requests_);
  }
  for (Sound& sound : sounds)
  {
    const SoundPlace place = mixer_.play(std::move(sound.samples));
    PlayedSound message;
    message.header.stamp = stampOf(place.begin);
    message.header.frame_id = options_.frame_id;
    message.file = sound.file;
    message.speech_end = stampOf(place.speech_end);
    message.end = stampOf(place.end);
    played_.publish(message);
  }
}

void SimulatedMicrophoneRos::send()
{
  std_msgs::Header header;
  header.stamp = stampOf(mixer_.position());
  header.frame_id = options_.frame_id;
  pi_speech::Samples samples = mixer_.next(MESSAGE);  // time goes on
  if (!plugged_)
  {
    return;
  }
  if (silent_)
  {
    std::fill(samples.begin(), samples.end(), int16_t{0});
  }
  audio_.publish(
      boost::make_shared<const pi_speech::AudioDataStamped>(pi_speech::toMsg(samples.data(), samples.size(), header)));
}

ros::Time SimulatedMicrophoneRos::stampOf(int64_t sample) const
{
  return begin_stamp_ + ros::Duration().fromNSec(nanosecondsOf(sample - begin_sample_));
}

}  // namespace pi_simulation
