#include "audio/sound_bytes.h"

#include <gtest/gtest.h>
#include "ros/sound_stream.h"

#include <cmath>
#include <vector>

namespace pi_speech
{
namespace
{

using Break = SoundStream::Break;

constexpr double MAX_GAP_S = 0.1;
constexpr int64_t MS = 1000000;
constexpr int64_t START = 1700000000123456789;
constexpr AudioFormat PLAIN{};

/// Adds sound of this length.
Samples add(SoundStream* stream, int64_t stamp_ns, const AudioFormat& format, double duration_s)
{
  const std::vector<int16_t> sound(
      static_cast<size_t>(std::lround(duration_s * format.sample_rate_hz) * format.channels), 1000);
  Samples out;
  stream->add(format, stamp_ns, sound.data(), sound.size(), &out);
  return out;
}

TEST(SoundStream, GivesPlainSoundAsItComes)
{
  SoundStream stream(MAX_GAP_S);
  EXPECT_EQ(0, stream.samples());
  EXPECT_EQ(0, stream.timeOf(0));
  const std::vector<int16_t> sound = counting(320);
  Samples out{7};
  stream.add(PLAIN, START, sound.data(), sound.size(), &out);
  ASSERT_EQ(321u, out.size());
  EXPECT_EQ(7, out[0]);
  EXPECT_EQ(sound, Samples(out.begin() + 1, out.end()));
  EXPECT_EQ(320, stream.samples());
}

TEST(SoundStream, SamplesHaveTheTimesOfTheirChunks)
{
  SoundStream stream(MAX_GAP_S);
  add(&stream, START, PLAIN, 0.02);
  add(&stream, START + 23 * MS, PLAIN, 0.02);  // 3 ms late
  EXPECT_EQ(START, stream.timeOf(0));
  EXPECT_EQ(START + 10 * MS, stream.timeOf(160));
  EXPECT_EQ(START + 23 * MS, stream.timeOf(320));
  EXPECT_EQ(START + 33 * MS, stream.timeOf(480));
  EXPECT_EQ(START + 63 * MS, stream.timeOf(960));  // that will come
}

TEST(SoundStream, TellsWhatDoesNotGoOn)
{
  SoundStream stream(MAX_GAP_S);
  EXPECT_EQ(Break::NONE, stream.look(PLAIN, START));
  EXPECT_EQ(0.0, stream.gapBefore(START));
  add(&stream, START, PLAIN, 0.5);
  EXPECT_EQ(Break::NONE, stream.look(PLAIN, START + 500 * MS));
  EXPECT_EQ(Break::NONE, stream.look(PLAIN, START + 599 * MS));
  EXPECT_EQ(Break::NONE, stream.look(PLAIN, START + 401 * MS));
  EXPECT_EQ(Break::GAP, stream.look(PLAIN, START + 601 * MS));
  EXPECT_EQ(Break::BACK, stream.look(PLAIN, START + 399 * MS));
  EXPECT_EQ(Break::BACK, stream.look(PLAIN, 0));
  EXPECT_EQ(Break::FORMAT, stream.look(AudioFormat{16000, 2}, START + 500 * MS));
  EXPECT_EQ(Break::FORMAT, stream.look(AudioFormat{8000, 1}, START + 500 * MS));
  EXPECT_DOUBLE_EQ(0.25, stream.gapBefore(START + 750 * MS));
  EXPECT_DOUBLE_EQ(-0.1, stream.gapBefore(START + 400 * MS));
}

TEST(SoundStream, PiecesFollowEachOtherWithTimesOfTheirOwn)
{
  SoundStream stream(MAX_GAP_S);
  add(&stream, START, PLAIN, 0.1);
  Samples rest;
  stream.end(&rest);
  EXPECT_TRUE(rest.empty());
  const int64_t later = START - 5000 * MS;  // a recording that begins again
  EXPECT_EQ(Break::NONE, stream.look(PLAIN, later));
  add(&stream, later, PLAIN, 0.1);
  EXPECT_EQ(3200, stream.samples());
  EXPECT_EQ(START + 50 * MS, stream.timeOf(800));
  EXPECT_EQ(later, stream.timeOf(1600));
  EXPECT_EQ(later + 50 * MS, stream.timeOf(2400));
  stream.end(&rest);
  stream.end(&rest);  // twice is as once
  EXPECT_EQ(3200, stream.samples());
}

TEST(SoundStream, OtherFormatsAreCountedAtTheRateOfTheStream)
{
  const AudioFormat stereo{44100, 2};
  SoundStream stream(MAX_GAP_S);
  add(&stream, START - 100 * MS, PLAIN, 0.1);
  Samples rest;
  stream.end(&rest);
  size_t given = 0;
  for (int i = 0; i < 10; ++i)
  {
    EXPECT_EQ(Break::NONE, stream.look(stereo, START + i * 100 * MS)) << i;
    given += add(&stream, START + i * 100 * MS, stereo, 0.1).size();
  }
  EXPECT_LE(given, 16000u);
  stream.end(&rest);
  given += rest.size();
  EXPECT_NEAR(16000.0, static_cast<double>(given), 2.0);  // the resampler rounds at its ends
  EXPECT_EQ(1600 + static_cast<int64_t>(given), stream.samples());
  // Not later, though the resampler holds samples back.
  EXPECT_NEAR(START + 500 * MS, stream.timeOf(1600 + 8000), 0.1 * MS);
  EXPECT_NEAR(START + 950 * MS, stream.timeOf(1600 + 15200), 0.1 * MS);
}

TEST(SoundStream, RemembersTimesOfTheLastMinutesOnly)
{
  SoundStream stream(MAX_GAP_S);
  for (int i = 0; i < 200; ++i)
  {
    add(&stream, START + i * 1000 * MS, PLAIN, 1.0);
  }
  // Older ones are extrapolated from what is known, which for stamps without jumps is the same.
  EXPECT_EQ(START, stream.timeOf(0));
  EXPECT_EQ(START + 199500 * MS, stream.timeOf(199 * 16000 + 8000));
}

}  // namespace
}  // namespace pi_speech
