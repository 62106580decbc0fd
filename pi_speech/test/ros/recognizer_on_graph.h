#pragma once

#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/AudioData.h>
#include <pi_speech/AudioDataStamped.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/SetCommands.h>
#include <pi_speech/VoiceCommand.h>
#include <pi_speech/audio.h>
#include <pi_speech/ros/audio_conversions.h>
#include <std_msgs/String.h>
#include <std_srvs/Empty.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;

/// A recording of one word; empty path where there are no recordings.
inline std::string clipPath(const std::string& name)
{
  const char* const data = std::getenv("PI_EDGE_DATA");
  return data == nullptr ? "" : std::string(data) + "/speech/commands/" + name;
}

/// What a microphone hears when nobody speaks, -70 dB of full scale.
inline Samples quiet(double duration_s, int rate_hz = SAMPLE_RATE_HZ)
{
  std::mt19937 generator(1);
  std::normal_distribution<double> noise(0.0, 10.0);
  Samples samples(static_cast<size_t>(std::lround(duration_s * rate_hz)));
  std::generate(samples.begin(), samples.end(), [&] { return static_cast<int16_t>(std::lround(noise(generator))); });
  return samples;
}

/// Half a second of quiet, a clip, and a second of quiet.
inline Samples spoken(const std::string& clip)
{
  Samples samples = quiet(0.5);
  const Samples word = readAudioFile(clipPath(clip));
  samples.insert(samples.end(), word.begin(), word.end());
  const Samples after = quiet(1.0);
  samples.insert(samples.end(), after.begin(), after.end());
  return samples;
}

/// A source of sound in a namespace, whose stamps follow its samples.
class SourceOnGraph
{
public:
  explicit SourceOnGraph(const std::string& name, const AudioFormat& format = AudioFormat()) : format_(format)
  {
    ros::NodeHandle node(name);
    info_ = node.advertise<AudioInfo>("audio_info", 1, true);
    stamped_ = node.advertise<AudioDataStamped>("audio_stamped", 0);
    plain_ = node.advertise<AudioData>("audio", 0);
    tell(toMsg(format));
    stamp_ = ros::Time::now();
  }
  void tell(const AudioInfo& info) { info_.publish(info); }
  void setFormat(const AudioFormat& format)
  {
    format_ = format;
    tell(toMsg(format));
  }
  uint32_t listeners() const { return stamped_.getNumSubscribers() + plain_.getNumSubscribers(); }
  bool waitForListener() const
  {
    return until(TIMEOUT_S, [this] { return listeners() > 0; });
  }

  /// Messages of 0.1 s. @param samples  interleaved. @return the stamp of the first.
  ros::Time send(const Samples& samples)
  {
    const ros::Time begin = stamp_;
    const auto full = static_cast<size_t>(format_.sample_rate_hz / 10 * format_.channels);
    for (size_t at = 0; at < samples.size(); at += full)
    {
      const size_t count = std::min(full, samples.size() - at);
      std_msgs::Header header;
      header.stamp = stamp_;
      header.frame_id = "test_microphone";
      send(toMsg(samples.data() + at, count, header));
      skip(static_cast<double>(count) / (format_.channels * format_.sample_rate_hz));
    }
    return begin;
  }
  void send(const AudioDataStamped& message)
  {
    if (stamped_.getNumSubscribers() > 0)
    {
      stamped_.publish(message);
    }
    else
    {
      plain_.publish(message.audio);
    }
  }
  /// Time passes without sound, or goes back.
  void skip(double duration_s) { stamp_ += ros::Duration(duration_s); }
  const ros::Time& stamp() const { return stamp_; }

private:
  AudioFormat format_;
  ros::Publisher info_;
  ros::Publisher stamped_;
  ros::Publisher plain_;
  ros::Time stamp_;
};

/// A recogniser that is loaded into a namespace of its name, /name/recognizer, with parameters for tests: sound is sent
/// faster than it is recognised.
class RecognizerOnGraph
{
public:
  explicit RecognizerOnGraph(const std::string& name)
    : name_("/" + name + "/recognizer")
    , commands("/" + name + "/command")
    , output("/" + name + "/recognizer/output")
    , rejected(name_ + "/rejected")
  {
    ros::param::del(name_);
    set("queue_s", 60.0);
    set("diagnostic_period", 0.1);
    set("warning_period_s", 2.0);
  }
  ~RecognizerOnGraph()
  {
    if (loaded_)
    {
      unloadNodelet(name_);
    }
  }
  RecognizerOnGraph(const RecognizerOnGraph&) = delete;
  RecognizerOnGraph& operator=(const RecognizerOnGraph&) = delete;

  template <typename Value>
  void set(const std::string& parameter, const Value& value)
  {
    ros::param::set(name_ + "/" + parameter, value);
  }
  bool load()
  {
    loaded_ = log.waitForNode() && loadNodelet(name_, "pi_speech/recognizer");
    return loaded_;
  }
  /// Until the commands are understood, and the messages get through.
  bool waitUntilReady() const
  {
    return diagnosed("recognition", "state", "listening") && commands.waitForPublisher() && output.waitForPublisher() &&
           rejected.waitForPublisher();
  }
  bool start() const { return call("start"); }
  bool stop() const { return call("stop"); }
  SetCommands::Response setCommands(const std::string& file, const std::vector<std::string>& texts) const
  {
    SetCommands service;
    service.request.file = file;
    service.request.commands = texts;
    if (!ros::service::waitForService(name_ + "/set_commands", ros::Duration(TIMEOUT_S)) ||
        !ros::service::call(name_ + "/set_commands", service))
    {
      service.response.message = "the service failed";
    }
    return service.response;
  }

  /// Of this recogniser's statuses; only what comes from clear() on.
  bool diagnosed(const std::string& status, const std::string& key, const std::string& value) const
  {
    return diagnostics.waitForValue(statusName(status), key, value);
  }
  bool diagnosedSummary(const std::string& status, int level, const std::string& part) const
  {
    return diagnostics.waitForSummary(statusName(status), level, part);
  }
  bool waitForCommands(size_t count) const
  {
    return until(TIMEOUT_S, [this, count] { return commands.messages().size() >= count; }) &&
           until(TIMEOUT_S, [this, count] { return output.messages().size() >= count; });
  }
  std::vector<std::string> heard() const
  {
    std::vector<std::string> texts;
    for (const auto& message : commands.messages())
    {
      texts.push_back(message->text);
    }
    return texts;
  }
  std::vector<std::string> said() const
  {
    std::vector<std::string> texts;
    for (const auto& message : output.messages())
    {
      texts.push_back(message->data);
    }
    return texts;
  }
  /// For the message of a failed test.
  std::string text() const
  {
    std::string text = "rejected:\n";
    for (const auto& message : rejected.messages())
    {
      text += "  \"" + message->text + "\" " + std::to_string(message->confidence) + "\n";
    }
    return text + diagnostics.text() + log.text();
  }

private:
  bool call(const std::string& service) const
  {
    std_srvs::Empty empty;
    return ros::service::waitForService(name_ + "/" + service, ros::Duration(TIMEOUT_S)) &&
           ros::service::call(name_ + "/" + service, empty);
  }
  /// As diagnostic_updater composes it: the node is the manager.
  std::string statusName(const std::string& status) const { return name_.substr(1) + ": " + status; }

  const std::string name_;
  bool loaded_ = false;

public:
  Collector<VoiceCommand> commands;
  Collector<std_msgs::String> output;
  Collector<VoiceCommand> rejected;
  DiagnosticCollector diagnostics;
  LogCollector log;
};

}  // namespace pi_speech
