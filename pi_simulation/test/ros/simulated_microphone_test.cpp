// Judge of simulated_microphone.test.

#include <gtest/gtest.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_simulation/PlayedSound.h>
#include <pi_simulation/SimulatorCommand.h>
#include <pi_speech/AudioDataStamped.h>
#include <pi_speech/AudioInfo.h>
#include <pi_speech/audio.h>
#include <pi_speech/ros/audio_conversions.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

namespace pi_simulation
{

using namespace pi_node::test_support;
namespace
{

constexpr int64_t SAMPLE_NS = 62500;

/// A microphone in a namespace.
struct Microphone
{
  explicit Microphone(const std::string& name)
    : audio("/" + name + "/audio_stamped", 0)
    , info("/" + name + "/audio_info")
    , played("/" + name + "/microphone/played")
    , play(ros::NodeHandle().advertise<std_msgs::String>("/" + name + "/microphone/play", 10))
    , command_service("/" + name + "/microphone/command")
  {
  }

  bool connected() const
  {
    return until(TIMEOUT_S,
                 [this] { return play.getNumSubscribers() > 0 && played.publishers() > 0 && audio.publishers() > 0; });
  }
  void say(const std::string& file) const
  {
    std_msgs::String message;
    message.data = file;
    play.publish(message);
  }
  /// @return what was wrong with it.
  std::string command(const std::string& line) const
  {
    SimulatorCommand call;
    call.request.line = line;
    if (!ros::service::waitForService(command_service, ros::Duration(TIMEOUT_S)) ||
        !ros::service::call(command_service, call))
    {
      return "no answer from " + command_service;
    }
    return call.response.success ? "" : call.response.message;
  }
  size_t messagesBetween(const ros::Time& begin, const ros::Time& end) const
  {
    size_t count = 0;
    for (const auto& message : audio.messages())
    {
      count += message->header.stamp >= begin && message->header.stamp < end ? 1 : 0;
    }
    return count;
  }
  bool waitUntilHeard(const ros::Time& time) const
  {
    return audio.waitFor([&time](const pi_speech::AudioDataStamped& message) { return message.header.stamp > time; });
  }

  Collector<pi_speech::AudioDataStamped> audio;
  Collector<pi_speech::AudioInfo> info;
  Collector<PlayedSound> played;
  ros::Publisher play;
  std::string command_service;
};

bool isSilence(const pi_speech::AudioDataStamped& message)
{
  return std::all_of(message.audio.data.begin(), message.audio.data.end(), [](uint8_t byte) { return byte == 0; });
}

/// 0.5 s: a tone in the first 0.3 s, then silence.
pi_speech::Samples word()
{
  pi_speech::Samples samples(8000, 0);
  for (size_t i = 0; i < 4800; ++i)
  {
    samples[i] = static_cast<int16_t>(std::lround(12000.0 * std::sin(0.4 * static_cast<double>(i))));
  }
  return samples;
}

void expectAWordWhereItSays(const Microphone& microphone, const LogCollector& log)
{
  const TemporaryFolder folder;
  const std::string file = folder.path() + "/word.wav";
  const pi_speech::Samples sound = word();
  pi_speech::writeWav(file, sound);
  ASSERT_TRUE(microphone.connected());
  ASSERT_TRUE(microphone.info.waitFor([](const pi_speech::AudioInfo&) { return true; }));
  EXPECT_EQ(pi_speech::AudioFormat(), pi_speech::fromMsg(*microphone.info.last()));

  const std::string broken = folder.file("broken.wav", "this is no sound");
  microphone.say(broken);
  EXPECT_TRUE(log.waitForText("sound file " + broken + ": is no sound that can be read")) << log.text();
  microphone.say(file);
  ASSERT_TRUE(microphone.played.waitFor([](const PlayedSound&) { return true; }));
  const auto played = microphone.played.last();
  EXPECT_EQ(file, played->file);
  EXPECT_EQ(4800 * SAMPLE_NS, (played->speech_end - played->header.stamp).toNSec());
  EXPECT_EQ(8000 * SAMPLE_NS, (played->end - played->header.stamp).toNSec());
  ASSERT_TRUE(microphone.waitUntilHeard(played->end));

  int64_t expected_ns = 0;
  int64_t heard = 0;
  std::vector<int16_t> samples;
  for (const auto& message : microphone.audio.messages())
  {
    const auto stamp_ns = static_cast<int64_t>(message->header.stamp.toNSec());
    EXPECT_EQ("microphone", message->header.frame_id);
    if (expected_ns != 0)
    {
      ASSERT_EQ(expected_ns, stamp_ns);
    }
    pi_speech::fromMsg(message->audio, pi_speech::AudioFormat(), &samples);
    ASSERT_EQ(320u, samples.size());
    expected_ns = stamp_ns + 320 * SAMPLE_NS;
    const int64_t first = (stamp_ns - static_cast<int64_t>(played->header.stamp.toNSec())) / SAMPLE_NS;
    for (int64_t i = 0; i < 320; ++i)
    {
      const int64_t at = first + i;
      const bool inside = at >= 0 && at < 8000;
      heard += inside ? 1 : 0;
      // -62 dBFS is 26 steps; six times that has never been seen.
      ASSERT_NEAR(inside ? sound[static_cast<size_t>(at)] : 0, samples[static_cast<size_t>(i)], 200) << at;
    }
  }
  EXPECT_EQ(8000, heard);
}

TEST(SimulatedMicrophone, AsANodePlaysAWordWhereItSays)
{
  const LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  expectAWordWhereItSays(Microphone("node"), log);
}

TEST(SimulatedMicrophone, AsANodeletPlaysAWordWhereItSays)
{
  const LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  const Microphone microphone("nodelet");
  ASSERT_TRUE(loadNodelet("/nodelet/microphone", "pi_simulation/simulated_microphone"));
  expectAWordWhereItSays(microphone, log);
  EXPECT_TRUE(unloadNodelet("/nodelet/microphone"));
}

TEST(SimulatedMicrophone, UnpluggedItSendsNothingAndPluggedInItGoesOnInTime)
{
  const Microphone microphone("node");
  ASSERT_TRUE(microphone.connected());
  const TemporaryFolder folder;
  const std::string file = folder.path() + "/word.wav";
  pi_speech::writeWav(file, word());
  ASSERT_EQ("", microphone.command("unplug"));
  const ros::Time unplugged = ros::Time::now();  // a message that began before may still come
  microphone.say(file);
  ASSERT_TRUE(microphone.played.waitFor([](const PlayedSound&) { return true; }));
  const ros::Time end = microphone.played.last()->end;
  // A stream that is late by more than 1 s begins anew.
  ASSERT_TRUE(until(TIMEOUT_S, [end] { return ros::Time::now() > end + ros::Duration(1.5); }));
  const ros::Time plugged = ros::Time::now();
  ASSERT_EQ("", microphone.command("plug"));
  ASSERT_TRUE(microphone.waitUntilHeard(plugged));
  EXPECT_EQ(0u, microphone.messagesBetween(unplugged, end));
  const auto newest = microphone.audio.last();
  EXPECT_EQ(320u * 2u, newest->audio.data.size());
  EXPECT_FALSE(isSilence(*newest));
}

TEST(SimulatedMicrophone, SilentItSendsZerosAndUnknownCommandsAreRefused)
{
  const Microphone microphone("node");
  ASSERT_TRUE(microphone.connected());
  ASSERT_EQ("", microphone.command("silent on"));
  EXPECT_TRUE(microphone.audio.waitFor(isSilence));
  ASSERT_EQ("", microphone.command("silent off"));
  const ros::Time later = ros::Time::now() + ros::Duration(0.1);
  EXPECT_TRUE(microphone.audio.waitFor([later](const pi_speech::AudioDataStamped& message)
                                       { return message.header.stamp > later && !isSilence(message); }));
  EXPECT_EQ("command \"dance\" is not understood, must be one of: unplug, plug, silent on|off",
            microphone.command("dance"));
}

TEST(SimulatedMicrophone, RefusesWrongParametersWithOneError)
{
  const LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  ros::param::set("/wrong/microphone/background", "/nowhere/hum.wav");
  EXPECT_FALSE(loadNodelet("/wrong/microphone", "pi_simulation/simulated_microphone"));
  EXPECT_TRUE(log.waitForText("sound file /nowhere/hum.wav: cannot be opened")) << log.text();
}

}  // namespace
}  // namespace pi_simulation

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "simulated_microphone_test");
}
