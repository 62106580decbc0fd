// Judge of recognizer.test.

#include "ros/recognizer_on_graph.h"
#include "ros/sound_on_graph.h"

#include <gtest/gtest.h>
#include <pi_runtime/GetEtc.h>
#include <std_msgs/Empty.h>

#include <string>
#include <vector>

namespace pi_speech
{
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;

using Texts = std::vector<std::string>;

// Clips that are spoken clearly.
constexpr char LEFT[] = "left/1acc97de_nohash_0.flac";
constexpr char RIGHT[] = "right/1acc97de_nohash_0.flac";
constexpr char YES[] = "yes/1acc97de_nohash_3.flac";
constexpr char STOP[] = "stop/5f814c23_nohash_0.flac";

#define SKIP_WITHOUT_RECORDINGS()                                    \
  if (clipPath("").empty())                                          \
  {                                                                  \
    GTEST_SKIP() << "needs the recordings: PI_EDGE_DATA is not set"; \
  }

/// Stereo of another rate, by lines between the samples.
Samples stereo(const Samples& sound, int rate_hz)
{
  const double step = static_cast<double>(SAMPLE_RATE_HZ) / rate_hz;
  Samples samples;
  for (double at = 0.0; at < static_cast<double>(sound.size() - 1); at += step)
  {
    const auto index = static_cast<size_t>(at);
    const double part = at - std::floor(at);
    const auto value = static_cast<int16_t>(std::lround((1.0 - part) * sound[index] + part * sound[index + 1]));
    samples.insert(samples.end(), 2, value);
  }
  return samples;
}

TEST(Recognizer, CommandsOfAPlayerComeInOrderWithTheTimesOfTheirSound)
{
  SKIP_WITHOUT_RECORDINGS();
  const Texts words{"left", "stop", "right", "yes"};
  RecognizerOnGraph recognizer("played");
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  const SoundCollector sound("played");
  const Collector<std_msgs::Empty> finished("/played/finished");
  ros::param::set("/played/player/files", Texts{clipPath(LEFT), clipPath(STOP), clipPath(RIGHT), clipPath(YES)});
  ros::param::set("/played/player/gap_s", 1.0);
  ros::param::set("/played/player/rate", 4.0);
  ASSERT_TRUE(loadNodelet("/played/player", "pi_speech/player"));
  ASSERT_TRUE(recognizer.waitForCommands(words.size())) << recognizer.text();
  EXPECT_TRUE(finished.waitFor([](const std_msgs::Empty&) { return true; }));
  EXPECT_TRUE(unloadNodelet("/played/player"));
  EXPECT_EQ(words, recognizer.heard()) << recognizer.text();
  EXPECT_EQ(words, recognizer.said());

  // A clip is 1 s, and so is the gap behind it. The first messages may have come before the test was connected.
  const AudioDataStamped& last = *sound.messages().back();
  const ros::Time begin = last.header.stamp + ros::Duration(static_cast<double>(last.audio.data.size()) / 32000.0) -
                          ros::Duration(2.0 * static_cast<double>(words.size()));
  const ros::Duration frames(0.05);  // that the end pointer takes for the edge of a clip
  const auto commands = recognizer.commands.messages();
  for (size_t i = 0; i < commands.size(); ++i)
  {
    const VoiceCommand& command = *commands[i];
    SCOPED_TRACE(command.text);
    const ros::Time clip = begin + ros::Duration(2.0 * static_cast<double>(i));
    EXPECT_GE(command.speech_start, clip - frames);
    EXPECT_GT(command.speech_end, command.speech_start + ros::Duration(0.1));
    EXPECT_LE(command.speech_end, clip + ros::Duration(1.0) + frames);
    EXPECT_EQ(command.speech_end, command.header.stamp);
    EXPECT_EQ("microphone", command.header.frame_id);
    EXPECT_GT(command.confidence, 0.0F);
    EXPECT_LE(command.confidence, 1.0F);
    EXPECT_TRUE(command.fast);  // all are heard in the stream
    EXPECT_GT(command.latency.toSec(), 0.0);
    EXPECT_LE(command.latency.toSec(), TIMEOUT_S);
  }
  recognizer.diagnostics.clear();
  EXPECT_TRUE(recognizer.diagnosed("recognition", "accepted", "4")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", OK, "last yes (")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("sound", "gaps", "0")) << recognizer.text();
}

TEST(Recognizer, HearsNothingWhileStoppedAndForgetsWhatWasHalfSaid)
{
  SKIP_WITHOUT_RECORDINGS();
  SourceOnGraph source("stopping");
  RecognizerOnGraph recognizer("stopping");
  recognizer.set("start_listening", false);
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.diagnosed("recognition", "state", "stopped")) << recognizer.text();
  EXPECT_EQ(0u, source.listeners());
  ASSERT_TRUE(recognizer.start());
  ASSERT_TRUE(source.waitForListener());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();

  // Until the middle of the word.
  Samples half = quiet(0.5);
  const Samples left = readAudioFile(clipPath(LEFT));
  half.insert(half.end(), left.begin(), left.begin() + SAMPLE_RATE_HZ / 2);
  source.send(half);
  ASSERT_TRUE(recognizer.diagnosed("sound", "speech", "yes")) << recognizer.text();
  ASSERT_TRUE(recognizer.stop());
  EXPECT_TRUE(until(TIMEOUT_S, [&source] { return source.listeners() == 0; }));
  source.send(spoken(RIGHT));  // nobody hears it
  recognizer.diagnostics.clear();
  EXPECT_TRUE(recognizer.diagnosed("recognition", "state", "stopped")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("sound", "speech", "no")) << recognizer.text();

  ASSERT_TRUE(recognizer.start());
  ASSERT_TRUE(source.waitForListener());
  source.send(spoken(YES));
  ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
  EXPECT_EQ(Texts{"yes"}, recognizer.heard());
  recognizer.diagnostics.clear();
  EXPECT_TRUE(recognizer.diagnosed("recognition", "heard", "1")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("sound", "gaps", "0")) << recognizer.text();
}

TEST(Recognizer, TakesOtherCommandsAndKeepsThemWhereThoseAskedForAreWrong)
{
  const TemporaryFolder folder;
  SourceOnGraph source("tables");
  RecognizerOnGraph recognizer("tables");
  recognizer.set("commands", folder.file("first.yaml", "commands: [up, down]\n"));
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  EXPECT_TRUE(recognizer.diagnosed("recognition", "commands", "up, down")) << recognizer.text();

  const SetCommands::Response good = recognizer.setCommands("", {" Left", "right"});
  EXPECT_TRUE(good.success) << good.message;
  EXPECT_EQ(0u, good.message.find("understands left, right")) << good.message;
  EXPECT_TRUE(recognizer.diagnosed("recognition", "commands", "left, right")) << recognizer.text();

  const std::string wrong = folder.file("wrong.yaml", "comands: [up]\n");
  for (const SetCommands::Response& bad :
       {recognizer.setCommands(wrong, {}), recognizer.setCommands("", {}), recognizer.setCommands("/no/such.yaml", {}),
        recognizer.setCommands("", {"go", "go"})})
  {
    EXPECT_FALSE(bad.success);
    EXPECT_NE(std::string::npos, bad.message.find("; these stay in use: left, right")) << bad.message;
  }
  EXPECT_TRUE(recognizer.log.waitForText(wrong)) << recognizer.text();
  EXPECT_TRUE(recognizer.log.waitForText("/no/such.yaml")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosedSummary("recognition", WARN, "is there twice; remove one; goes on with 2 commands"))
      << recognizer.text();
  EXPECT_NE(std::string::npos, recognizer.setCommands("a.yaml", {}).message.find("must be an absolute path"));
  EXPECT_NE(std::string::npos, recognizer.setCommands(wrong, {"up"}).message.find("must be one of them"));

  SKIP_WITHOUT_RECORDINGS();
  source.send(spoken(LEFT));
  source.send(spoken(RIGHT));
  ASSERT_TRUE(recognizer.waitForCommands(2)) << recognizer.text();
  EXPECT_EQ((Texts{"left", "right"}), recognizer.heard());
}

TEST(Recognizer, UnderstandsSoundOfOtherRatesAndChannelsAndChangesOnTheWay)
{
  SKIP_WITHOUT_RECORDINGS();
  const AudioFormat format{44100, 2};
  SourceOnGraph source("stereo", format);
  RecognizerOnGraph recognizer("stereo");
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  ASSERT_TRUE(recognizer.diagnosed("sound", "format", "44100 Hz, 2 channels")) << recognizer.text();
  const ros::Time begin = source.send(stereo(spoken(LEFT), format.sample_rate_hz));
  ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
  const VoiceCommand& left = *recognizer.commands.last();
  EXPECT_EQ("left", left.text);
  EXPECT_GE(left.speech_start, begin + ros::Duration(0.45));
  EXPECT_LE(left.speech_end, begin + ros::Duration(1.55));
  EXPECT_EQ("test_microphone", left.header.frame_id);

  source.setFormat(AudioFormat());
  ASSERT_TRUE(recognizer.diagnosed("sound", "format", "16000 Hz, 1 channel")) << recognizer.text();
  const ros::Time second = source.send(spoken(RIGHT));
  ASSERT_TRUE(recognizer.waitForCommands(2)) << recognizer.text();
  EXPECT_EQ("right", recognizer.commands.last()->text);
  EXPECT_GE(recognizer.commands.last()->speech_start, second + ros::Duration(0.45));
  EXPECT_TRUE(recognizer.diagnosed("sound", "changes of format", "1")) << recognizer.text();
}

TEST(Recognizer, UnderstandsSoundWithoutStampsAndWithoutInfo)
{
  SKIP_WITHOUT_RECORDINGS();
  ros::Publisher plain = ros::NodeHandle().advertise<AudioData>("/plain/audio", 0);
  RecognizerOnGraph recognizer("plain");
  recognizer.set("stamped", false);
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(until(TIMEOUT_S, [&plain] { return plain.getNumSubscribers() > 0; }));
  const Samples sound = spoken(LEFT);
  const ros::Time before = ros::Time::now();
  plain.publish(toMsg(sound.data(), sound.size(), std_msgs::Header()).audio);
  ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
  EXPECT_EQ(Texts{"left"}, recognizer.heard());
  // The arrival is that of the last sample; the word lay 1 to 2 s before it.
  const VoiceCommand& command = *recognizer.commands.last();
  EXPECT_LT(command.speech_end, ros::Time::now() - ros::Duration(1.0));
  EXPECT_GT(command.speech_start, before - ros::Duration(2.5));
  EXPECT_TRUE(
      recognizer.log.waitForText("/plain/audio: no audio_info yet, the sound is taken as 16000 Hz, channels = 1"))
      << recognizer.text();
}

TEST(Recognizer, SoundThatCannotBeIsNamedAndPassedOver)
{
  SourceOnGraph source("wrong_sound");
  RecognizerOnGraph recognizer("wrong_sound");
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  ASSERT_TRUE(recognizer.diagnosed("sound", "format", "16000 Hz, 1 channel")) << recognizer.text();

  AudioDataStamped truncated;
  truncated.header.stamp = source.stamp();
  truncated.audio.data.resize(641);
  for (int i = 0; i < 3; ++i)
  {
    source.send(truncated);
  }
  EXPECT_TRUE(recognizer.diagnosed("sound", "messages that could not be used", "3")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosedSummary("sound", ERROR, "/wrong_sound/audio_stamped: audio.data has 641 bytes"))
      << recognizer.text();
  EXPECT_TRUE(recognizer.log.waitForText("audio.data has 641 bytes, must be a multiple of 2")) << recognizer.text();

  AudioInfo compressed = toMsg(AudioFormat());
  compressed.coding_format = "mp3";
  source.tell(compressed);
  EXPECT_TRUE(recognizer.diagnosedSummary("sound", ERROR, "/wrong_sound/audio_info: coding_format = \"mp3\""))
      << recognizer.text();
  EXPECT_TRUE(recognizer.log.waitForText("coding_format = \"mp3\", must be wave")) << recognizer.text();
  source.send(quiet(0.1));
  EXPECT_TRUE(recognizer.diagnosed("sound", "messages that could not be used", "4")) << recognizer.text();
  size_t said = 0;
  for (const auto& line : recognizer.log.messages())
  {
    said += line->level >= rosgraph_msgs::Log::ERROR ? 1 : 0;
  }
  EXPECT_EQ(2u, said) << recognizer.text();  // one of each

  // Good sound is good again.
  source.setFormat(AudioFormat());
  ASSERT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      recognizer.diagnostics.clear();
                      source.send(quiet(1.0));
                      return recognizer.diagnosedSummary("sound", OK, "/wrong_sound/audio_stamped comes, level -70 dB");
                    }))
      << recognizer.text();
}

TEST(Recognizer, NamesSilenceMissingSoundGapsAndStampsThatGoBack)
{
  SourceOnGraph source("poor_sound");
  RecognizerOnGraph recognizer("poor_sound");
  recognizer.set("check/silent_s", 1.0);
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  source.send(Samples(static_cast<size_t>(3 * SAMPLE_RATE_HZ), 0));
  EXPECT_TRUE(recognizer.diagnosedSummary("sound", WARN, "/poor_sound/audio_stamped: all samples are the same for"))
      << recognizer.text();
  EXPECT_TRUE(recognizer.log.waitForText("is the microphone muted or unplugged?")) << recognizer.text();

  source.skip(0.05);  // clocks shake
  source.send(quiet(0.2));
  source.skip(0.5);
  source.send(quiet(0.2));
  EXPECT_TRUE(recognizer.log.waitForText("0.50 s of sound are missing before a message")) << recognizer.text();
  source.skip(-100.0);
  source.send(quiet(0.2));
  EXPECT_TRUE(recognizer.log.waitForText("stamps went back by 100.00 s")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("sound", "gaps", "1")) << recognizer.text();
  EXPECT_TRUE(recognizer.diagnosed("sound", "times that stamps went back", "1")) << recognizer.text();

  // The source falls silent.
  EXPECT_TRUE(recognizer.diagnosedSummary("sound", WARN, "no sound for")) << recognizer.text();
  EXPECT_TRUE(recognizer.commands.messages().empty());
}

TEST(Recognizer, NamesSpeechThatDoesNotEnd)
{
  SourceOnGraph source("endless");
  RecognizerOnGraph recognizer("endless");
  recognizer.set("end_pointer/max_utterance_s", 1.0);
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  Samples roar = quiet(2.0);
  for (int16_t& sample : roar)
  {
    sample = static_cast<int16_t>(100 * sample);  // -30 dB of full scale
  }
  source.send(quiet(1.0));
  source.send(roar);
  EXPECT_TRUE(recognizer.log.waitForText("/endless/audio_stamped: speech without a pause for 1.0 s is cut"))
      << recognizer.text();
}

TEST(Recognizer, SpeechEndsWhereSoundStaysAwayOrIsMissing)
{
  SKIP_WITHOUT_RECORDINGS();
  SourceOnGraph source("cut");
  RecognizerOnGraph recognizer("cut");
  recognizer.set("check/missing_s", 0.5);
  recognizer.set("end_pointer/end_silence_s", 1.0);  // longer than what follows the word in the clip
  recognizer.set("end_pointer/early_silence_s", 0.0);
  recognizer.set("word_network", std::string("none"));  // it does not wait for an end
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  Samples sound = quiet(0.5);
  const Samples left = readAudioFile(clipPath(LEFT));
  sound.insert(sound.end(), left.begin(), left.end());
  source.send(sound);
  ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
  // The wait counts.
  EXPECT_GE(recognizer.commands.last()->latency.toSec(), 0.5);
  // The end of a piece of the stream has a time of its own sound, also where more follows.
  source.skip(10.0);
  const ros::Time begin = source.send(sound);
  source.skip(10.0);
  source.send(quiet(0.1));
  ASSERT_TRUE(recognizer.waitForCommands(2)) << recognizer.text();
  EXPECT_EQ((Texts{"left", "left"}), recognizer.heard());
  EXPECT_GE(recognizer.commands.last()->speech_start, begin + ros::Duration(0.45));
  EXPECT_LE(recognizer.commands.last()->speech_end, begin + ros::Duration(1.501));
}

TEST(Recognizer, DropsTheOldestSoundWhereTooMuchComesAtOnce)
{
  SourceOnGraph source("too_much");
  RecognizerOnGraph recognizer("too_much");
  recognizer.set("queue_s", 1.0);
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  // More than the queue takes, in messages of 0.9 s: two never fit.
  const Samples sound = quiet(0.9);
  AudioDataStamped message = toMsg(sound.data(), sound.size(), std_msgs::Header());
  const auto dropped = [&]
  {
    recognizer.diagnostics.clear();
    for (int i = 0; i < 100; ++i)
    {
      message.header.stamp = source.stamp();
      source.send(message);
      source.skip(0.9);
    }
    return recognizer.log.waitFor(
        [](const rosgraph_msgs::Log& line)
        { return line.msg.find("more than 1.0 s of sound wait, the oldest is dropped") != std::string::npos; },
        1.0);
  };
  EXPECT_TRUE(until(TIMEOUT_S, dropped)) << recognizer.text();
  recognizer.diagnostics.clear();
  EXPECT_TRUE(recognizer.diagnosed("sound", "gaps", "0")) << recognizer.text();  // they are counted as what they are
}

TEST(Recognizer, DecisionsAreAStageOfTheRuntimeThatTheProcessShares)
{
  SKIP_WITHOUT_RECORDINGS();
  ros::param::set("/tasks/runtime/opencl_cpu", false);
  ASSERT_TRUE(loadNodelet("/tasks/runtime", "pi_runtime/runtime"));
  pi_runtime::GetEtc table;
  const auto learned = [&table]
  {
    uint64_t runs = 0;
    if (ros::service::call("/tasks/runtime/get_etc", table))
    {
      for (const pi_runtime::EtcEntry& entry : table.response.entries)
      {
        runs += entry.codelet == "speech_decode" ? entry.count : 0;
      }
    }
    return runs;
  };
  ASSERT_TRUE(ros::service::waitForService("/tasks/runtime/get_etc", ros::Duration(TIMEOUT_S)));
  {
    SourceOnGraph source("plain_calls");
    RecognizerOnGraph recognizer("plain_calls");
    recognizer.set("use_runtime", false);
    recognizer.set("word_network", std::string("none"));
    ASSERT_TRUE(recognizer.load());
    ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
    ASSERT_TRUE(source.waitForListener());
    const uint64_t before = learned();
    source.send(spoken(LEFT));
    ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
    EXPECT_TRUE(recognizer.diagnosed("recognition", "runtime", "not used: plain calls")) << recognizer.text();
    EXPECT_EQ(before, learned());
  }
  SourceOnGraph source("tasks");
  RecognizerOnGraph recognizer("tasks");
  recognizer.set("word_network", std::string("none"));  // PocketSphinx decides
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  const uint64_t before = learned();
  size_t commands = 0;
  // A task that no unit begins in time is taken back; that is no more than now and then.
  EXPECT_TRUE(until(TIMEOUT_S,
                    [&]
                    {
                      source.send(spoken(LEFT));
                      return recognizer.waitForCommands(++commands) && learned() > before;
                    }))
      << recognizer.text();
  EXPECT_EQ(Texts(commands, "left"), recognizer.heard());
  EXPECT_TRUE(recognizer.diagnosed("recognition", "runtime", "nothing reserved: its times are measured first"))
      << recognizer.text();
  EXPECT_TRUE(unloadNodelet("/tasks/runtime"));
}

TEST(Recognizer, WritesOtherSpeechDown)
{
  SKIP_WITHOUT_RECORDINGS();
  const TemporaryFolder folder;
  SourceOnGraph source("written");
  RecognizerOnGraph recognizer("written");
  recognizer.set("dictation", true);
  recognizer.set("commands", folder.file("commands.yaml", "commands: [halt the vehicle at once]\n"));
  ASSERT_TRUE(recognizer.load());
  const Collector<std_msgs::String> dictation("/written/dictation");
  ASSERT_TRUE(dictation.waitForPublisher());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  const bool written = until(TIMEOUT_S,
                             [&]
                             {
                               source.send(spoken(YES));  // until the language model is there
                               return dictation.waitFor([](const std_msgs::String&) { return true; }, 1.0);
                             });
  ASSERT_TRUE(written) << recognizer.text();
  EXPECT_FALSE(dictation.last()->data.empty());
  EXPECT_TRUE(recognizer.commands.messages().empty());
  EXPECT_FALSE(recognizer.rejected.messages().empty());
}

}  // namespace
}  // namespace pi_speech

int main(int argc, char** argv)
{
  return pi_speech::runOnGraph(argc, argv, "recognizer_test");
}
