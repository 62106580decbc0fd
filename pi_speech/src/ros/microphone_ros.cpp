#include "ros/microphone_ros.h"
#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_speech/ros/audio_conversions.h>

#include <boost/make_shared.hpp>
#include <chrono>
#include <vector>

namespace pi_speech
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

constexpr uint32_t SOUND_QUEUE = 100;  ///< messages that wait for a subscriber: 2 s of 20 ms

/// Converts a time of the system's clock to ROS time, which may be simulated.
ros::Time rosTime(int64_t system_ns)
{
  if (!ros::Time::isSimTime())
  {
    return ros::Time().fromNSec(static_cast<uint64_t>(system_ns));
  }
  using std::chrono::nanoseconds;
  const auto system_now = std::chrono::system_clock::now().time_since_epoch();
  const ros::Duration age =
      ros::Duration().fromNSec(std::chrono::duration_cast<nanoseconds>(system_now).count() - system_ns);
  const ros::Time now = ros::Time::now();
  return now.toSec() > age.toSec() ? now - age : now;
}
}  // namespace

MicrophoneRos::MicrophoneRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : service_thread_("mic_service")
  , service_node_(service_thread_.handle(node))
  , options_(pi_node::loadNodeOptions<MicrophoneRosOptions>(private_node, "microphone"))
  , warnings_(options_.warning_period_s, pi_node::warningLog<MicrophoneRosOptions>("microphone"))
  , watch_(options_.check, "", &warnings_)
  , updater_(service_node_, private_node, private_node.getNamespace())
{
  audio_ = service_node_.advertise<AudioDataStamped>("audio_stamped", SOUND_QUEUE);
  info_ = pi_node::LatchedPublisher<AudioInfo>(service_node_, "audio_info", 1);
  updater_.setHardwareID(options_.microphone.device);
  updater_.add("microphone", [this](Status& status) { reportDevice(status); });
  updater_.add("sound", [this](Status& status) { reportSound(status); });
  timer_ = pi_node::VehicleTimer(service_node_, options_.diagnostic_period, [this] { publishDiagnostics(); });

  MicrophoneEvents events;
  events.sound = [this](const MicrophoneSound& sound) { onSound(sound); };
  events.found = [this](const std::string& device, const AudioFormat& format) { onFound(device, format); };
  events.lost = [this](const std::string& problem) { onLost(problem); };
  microphone_ = std::make_unique<Microphone>(options_.microphone, std::move(events));
  service_thread_.start();
}

MicrophoneRos::~MicrophoneRos()
{
  service_thread_.stop();
  microphone_->stop();
}

// --------------------------------------------------------------------------------------------------------- microphone

void MicrophoneRos::onFound(const std::string& device, const AudioFormat& format)
{
  const AudioFormat& wanted = options_.microphone.format;
  ROS_INFO_STREAM_NAMED("microphone", "records from " << device << ": " << toString(format)
                                                      << (format == wanted ? "" : ", wanted " + toString(wanted)));
  if (!format_published_ || !(published_format_ == format))
  {
    info_.publish(toMsg(format));
    published_format_ = format;
    format_published_ = true;
  }
}

void MicrophoneRos::onLost(const std::string& problem)
{
  ROS_ERROR_STREAM_NAMED("microphone", problem << "; tried again every " << options_.microphone.retry_s << " s");
}

void MicrophoneRos::onSound(const MicrophoneSound& sound)
{
  std_msgs::Header header;
  header.stamp = rosTime(sound.stamp_ns);
  header.frame_id = options_.frame_id;
  audio_.publish(boost::make_shared<const AudioDataStamped>(toMsg(sound.samples, sound.count, header)));
  watch_.add(sound.format, sound.samples, sound.count);
}

// -------------------------------------------------------------------------------------------------------- mic_service

void MicrophoneRos::publishDiagnostics()
{
  status_ = microphone_->status();
  if (status_.overruns > overruns_warned_)
  {
    overruns_warned_ = status_.overruns;
    warnings_.warn("sound was lost " + std::to_string(status_.overruns) +
                   " times, as it was not taken in time; the computer is too busy, or buffer_s is too short");
  }
  updater_.setHardwareID(status_.device.empty() ? options_.microphone.device : status_.device);
  updater_.force_update();
}

void MicrophoneRos::reportDevice(Status& status) const
{
  if (status_.recording)
  {
    status.summary(DiagnosticStatus::OK, status_.device + ", " + toString(status_.format));
  }
  else if (!status_.problem.empty())
  {
    status.summary(DiagnosticStatus::ERROR, status_.problem);
  }
  else
  {
    status.summary(DiagnosticStatus::WARN, "opens " + options_.microphone.device);
  }
  status.add("device wanted", options_.microphone.device);
  status.add("device", status_.device);
  status.add("sample rate [Hz]", status_.format.sample_rate_hz);
  status.add("channels", status_.format.channels);
  status.add("samples", status_.samples);
  status.add("overruns", status_.overruns);
  status.add("times that the computer slept", status_.suspends);
  status.add("times that the device was lost", status_.times_lost);
}

void MicrophoneRos::reportSound(Status& status) const
{
  const SoundWatch::Figures sound = watch_.figures();
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_.recent();
  if (!status_.recording)
  {
    status.summary(DiagnosticStatus::WARN, "no sound");
  }
  else if (sound.last.state != SoundState::GOOD)
  {
    status.summary(DiagnosticStatus::WARN, sound.last.text);
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK, format("level %.0f dB of full scale", sound.level_dbfs));
  }
  status.add("level [dB of full scale]", format("%.1f", sound.level_dbfs));
  status.add("clipped [%]", format("%.2f", 100.0 * sound.clipped_share));
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_speech
