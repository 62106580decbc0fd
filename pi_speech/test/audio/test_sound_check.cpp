// What is wrong with the sound is said once, when it begins, and when it is over.

#include "audio/sound_bytes.h"

#include <gtest/gtest.h>
#include "audio/sound_check.h"

#include <cmath>
#include <functional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{
namespace
{

constexpr int64_t SECOND_NS = 1000000000;

/// Sound of a level [dB of full scale].
std::vector<int16_t> noise(double level_dbfs, double duration_s)
{
  std::mt19937 random(7);
  std::normal_distribution<double> values(0.0, 32768.0 * std::pow(10.0, level_dbfs / 20.0));
  std::vector<int16_t> samples(static_cast<size_t>(duration_s * SAMPLE_RATE_HZ));
  for (int16_t& sample : samples)
  {
    sample = static_cast<int16_t>(std::lround(std::max(-32768.0, std::min(32767.0, values(random)))));
  }
  return samples;
}

/// Feeds pieces of 20 ms, and keeps what is said.
class Stream
{
public:
  explicit Stream(const SoundCheckOptions& options = {}) : check(options, 0) {}

  void add(const std::vector<int16_t>& samples, const AudioFormat& format = {})
  {
    const auto piece = static_cast<size_t>(format.sample_rate_hz / 50 * format.channels);
    for (size_t begin = 0; begin < samples.size(); begin += piece)
    {
      const size_t count = std::min(piece, samples.size() - begin);
      now_ns += 20000000;
      keep(check.add(format, samples.data() + begin, count, now_ns));
    }
  }
  void wait(double duration_s)
  {
    for (int i = 0; i < static_cast<int>(duration_s * 10.0); ++i)
    {
      now_ns += SECOND_NS / 10;
      keep(check.look(now_ns));
    }
  }
  std::vector<std::string> states() const
  {
    std::vector<std::string> names;
    for (const SoundChange& change : said)
    {
      names.emplace_back(toString(change.state));
    }
    return names;
  }

  SoundCheck check;
  int64_t now_ns = 0;
  std::vector<SoundChange> said;

private:
  void keep(const std::optional<SoundChange>& change)
  {
    if (change)
    {
      said.push_back(*change);
    }
  }
};

using States = std::vector<std::string>;

TEST(SoundCheck, SaysNothingOfGoodSound)
{
  Stream stream;
  stream.add(noise(-30.0, 30.0));
  EXPECT_EQ(States(), stream.states());
  EXPECT_EQ(30u, stream.check.windows());
  EXPECT_NEAR(-30.0, stream.check.levelDbfs(), 0.3);
}

TEST(SoundCheck, ClippedSoundIsSaidOnceAndWhenItIsOver)
{
  Stream stream;
  stream.add(noise(-30.0, 2.0));
  stream.add(noise(-3.0, 5.0));
  ASSERT_EQ(States({"clipped"}), stream.states());
  EXPECT_NE(std::string::npos, stream.said[0].text.find("of the samples are at full scale, at most 0.5 may be; turn "))
      << stream.said[0].text;
  EXPECT_GT(stream.check.clippedShare(), 0.005);
  stream.add(noise(-30.0, 5.0));
  EXPECT_EQ(States({"clipped", "good"}), stream.states());
}

/// Sound of two channels that is in each at a gain, and beside it sound of its own.
std::vector<int16_t> stereo(double left, double right, double duration_s, double own = 0.0)
{
  const std::vector<int16_t> common = noise(-30.0, duration_s);
  std::mt19937 random(8);
  std::normal_distribution<double> values(0.0, own);
  std::vector<int16_t> samples;
  for (const int16_t sample : common)
  {
    for (const double gain : {left, right})
    {
      samples.push_back(static_cast<int16_t>(std::lround(gain * sample + (own > 0.0 ? values(random) : 0.0))));
    }
  }
  return samples;
}

TEST(SoundCheck, SoundFarFromZeroIsSaidOnce)
{
  Stream stream;
  std::vector<int16_t> samples = noise(-30.0, 5.0);
  for (int16_t& sample : samples)
  {
    sample = static_cast<int16_t>(sample + 10000);
  }
  stream.add(samples);
  stream.add(noise(-30.0, 2.0));
  stream.add(samples);
  ASSERT_EQ(States({"offset", "good"}), stream.states());
  EXPECT_EQ(0U, stream.said[0].text.find("channel 0 is 0.31 of full scale away from 0")) << stream.said[0].text;
}

TEST(SoundCheck, ChannelsThatCancelEachOtherAreSaidOnceAcrossPauses)
{
  const AudioFormat format{SAMPLE_RATE_HZ, 2};
  Stream stream;
  for (int sentence = 0; sentence < 3; ++sentence)
  {
    stream.add(stereo(1.0, -1.0, 2.0, 30.0), format);
    stream.add(stereo(0.0, 0.0, 2.0, 30.0), format);  // the noise of each microphone
  }
  ASSERT_EQ(States({"cancelling", "good", "good", "good"}), stream.states());
  EXPECT_NE(std::string::npos, stream.said[0].text.find("swap the wires")) << stream.said[0].text;
}

TEST(SoundCheck, AChannelWithoutSoundIsSaid)
{
  const AudioFormat format{SAMPLE_RATE_HZ, 2};
  Stream stream;
  stream.add(stereo(1.0, 0.0, 3.0), format);
  ASSERT_EQ(States({"dead channel"}), stream.states());
  EXPECT_EQ(0U, stream.said[0].text.find("channel 1 has no sound")) << stream.said[0].text;
}

TEST(SoundCheck, NothingIsSaidOfChannelsThatDifferAsInARoom)
{
  const AudioFormat format{SAMPLE_RATE_HZ, 2};
  for (const double right : {1.0, 0.3, 0.05})
  {
    Stream stream;
    stream.add(stereo(1.0, right, 3.0, 300.0), format);
    EXPECT_EQ(States(), stream.states()) << right;
  }
}

TEST(SoundCheck, ALowRateIsSaid)
{
  Stream stream;
  stream.add(noise(-30.0, 3.0), {8000, 1});
  ASSERT_EQ(States({"narrow"}), stream.states());
  EXPECT_EQ(0U, stream.said[0].text.find("sound at 8000 Hz lacks")) << stream.said[0].text;
}

TEST(ClippingRecord, KnowsTheShareOfThePieceOfAWord)
{
  ClippingRecord record;
  EXPECT_EQ(0.0, record.shareSince(0));
  const std::vector<int16_t> good(1600, 100);
  std::vector<int16_t> loud(1600, 100);
  std::fill_n(loud.begin(), 400, -32768);
  record.add(good.data(), good.size(), 1600);
  record.add(loud.data(), loud.size(), 3200);
  EXPECT_NEAR(0.125, record.shareSince(0), 1e-9);
  EXPECT_NEAR(0.25, record.shareSince(1600), 1e-9);
  EXPECT_EQ(0.0, record.shareSince(3200));
  record.add(good.data(), good.size(), 3200 + static_cast<int64_t>(10.0 * SAMPLE_RATE_HZ));
  EXPECT_EQ(0.0, record.shareSince(0)) << "older sound is forgotten";
}

TEST(SoundCheck, FewLoudSamplesAreNotClipped)
{
  Stream stream;
  std::vector<int16_t> samples = noise(-30.0, 10.0);
  for (size_t i = 0; i < samples.size(); i += 1000)
  {
    samples[i] = 32767;
  }
  stream.add(samples);
  EXPECT_EQ(States(), stream.states());
  EXPECT_NEAR(0.001, stream.check.clippedShare(), 1e-9);
}

TEST(SoundCheck, ShareAroundTheBoundDoesNotComeAndGo)
{
  Stream stream;
  for (int second = 0; second < 10; ++second)
  {
    std::vector<int16_t> samples = noise(-30.0, 1.0);
    const size_t loud = second % 2 == 0 ? 88 : 72;  // 0.55 % and 0.45 %
    for (size_t i = 0; i < loud; ++i)
    {
      samples[i] = -32768;
    }
    stream.add(samples);
  }
  EXPECT_EQ(States({"clipped"}), stream.states());
}

TEST(SoundCheck, SilenceIsSaidAfterItsTime)
{
  Stream stream;
  stream.add(noise(-30.0, 3.0));
  stream.add(std::vector<int16_t>(9 * SAMPLE_RATE_HZ, 0));
  EXPECT_EQ(States(), stream.states());
  stream.add(std::vector<int16_t>(20 * SAMPLE_RATE_HZ, 0));
  ASSERT_EQ(States({"silent"}), stream.states());
  EXPECT_EQ("all samples are the same for 10 s; is the microphone muted or unplugged?", stream.said[0].text);
  stream.add(noise(-40.0, 2.0));
  EXPECT_EQ(States({"silent", "good"}), stream.states());
}

TEST(SoundCheck, PausesOfSpeechAreNotSilence)
{
  Stream stream;
  for (int i = 0; i < 10; ++i)
  {
    stream.add(std::vector<int16_t>(8 * SAMPLE_RATE_HZ, 0));
    stream.add(noise(-30.0, 2.0));
  }
  EXPECT_EQ(States(), stream.states());
}

TEST(SoundCheck, OffsetAndHumOfAMutedMicrophoneAreSilence)
{
  Stream offset;
  offset.add(std::vector<int16_t>(11 * SAMPLE_RATE_HZ, 700));
  EXPECT_EQ(States({"silent"}), offset.states());
  Stream hum;
  hum.add(noise(-80.0, 11.0));
  ASSERT_EQ(States({"silent"}), hum.states());
  EXPECT_EQ(0u, hum.said[0].text.find("level -80 dB of full scale for 10 s; ")) << hum.said[0].text;
}

TEST(SoundCheck, MissingSoundIsSaidOnceAndWhenItIsBack)
{
  Stream stream;
  stream.wait(1.9);
  EXPECT_EQ(States(), stream.states());
  stream.wait(5.0);
  ASSERT_EQ(States({"missing"}), stream.states());
  EXPECT_EQ(0u, stream.said[0].text.find("no sound for 2.0 s; ")) << stream.said[0].text;
  stream.add(noise(-30.0, 1.0));
  stream.wait(1.0);
  EXPECT_EQ(States({"missing", "good"}), stream.states());
  EXPECT_FALSE(stream.check.add(AudioFormat(), nullptr, 0, stream.now_ns + SECOND_NS / 2).has_value());
  EXPECT_EQ(SoundState::MISSING, stream.check.add(AudioFormat(), nullptr, 0, stream.now_ns + 5 * SECOND_NS)->state);
}

TEST(SoundCheck, SilenceThatComesBackAfterAGapTakesItsTimeAgain)
{
  Stream stream;
  stream.add(std::vector<int16_t>(8 * SAMPLE_RATE_HZ, 0));
  stream.wait(3.0);
  stream.add(std::vector<int16_t>(8 * SAMPLE_RATE_HZ, 0));
  EXPECT_EQ(States({"missing", "good"}), stream.states());
}

TEST(SoundCheck, WindowsAreOfTimeAtEveryRateAndNumberOfChannels)
{
  Stream stream;
  stream.add(std::vector<int16_t>(2 * 2 * 48000, 1000), {48000, 2});
  EXPECT_EQ(2u, stream.check.windows());
  stream.add(std::vector<int16_t>(SAMPLE_RATE_HZ / 2, 1000));
  stream.add(std::vector<int16_t>(48000, 1000), {48000, 2});  // half a second: the half of before does not count
  EXPECT_EQ(2u, stream.check.windows());
}

TEST(SoundCheckOptions, NameFieldValueAndBound)
{
  const auto refusal = [](const std::function<void(SoundCheckOptions*)>& change)
  {
    SoundCheckOptions options;
    change(&options);
    try
    {
      SoundCheck(options, 0);
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ("", refusal([](SoundCheckOptions*) {}));
  EXPECT_EQ("clipped_share = 0, must be in [1e-06, 1]",
            refusal([](SoundCheckOptions* options) { options->clipped_share = 0.0; }));
  EXPECT_EQ("silent_level_dbfs = 3, must be in [-120, 0]",
            refusal([](SoundCheckOptions* options) { options->silent_level_dbfs = 3.0; }));
  EXPECT_EQ("silent_s = 0, must be in [1, 3600]", refusal([](SoundCheckOptions* options) { options->silent_s = 0.0; }));
  EXPECT_EQ("missing_s = nan, must be in [0.1, 3600]",
            refusal([](SoundCheckOptions* options) { options->missing_s = std::nan(""); }));
  EXPECT_EQ("window_s = 11, must be in [0.05, 10]",
            refusal([](SoundCheckOptions* options) { options->window_s = 11.0; }));
}

}  // namespace
}  // namespace pi_speech
