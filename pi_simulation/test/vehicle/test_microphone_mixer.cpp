// What the simulated microphone hears: noise of a level, a background, and sounds at the places that it tells.

#include "vehicle/microphone_mixer.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/audio.h>

#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_simulation
{
namespace
{

using pi_speech::Samples;

double levelDbfs(const Samples& samples)
{
  double squares = 0.0;
  for (const int16_t sample : samples)
  {
    squares += static_cast<double>(sample) * sample;
  }
  return 10.0 * std::log10(squares / static_cast<double>(samples.size()) / (32768.0 * 32768.0));
}

/// Silence with a tone from one sample to another.
Samples toneIn(size_t count, size_t begin, size_t end, double amplitude = 8000.0)
{
  Samples samples(count, 0);
  for (size_t i = begin; i < end; ++i)
  {
    samples[i] = static_cast<int16_t>(std::lround(amplitude * std::sin(0.3 * static_cast<double>(i))));
  }
  return samples;
}

MicrophoneMixerOptions silent()
{
  MicrophoneMixerOptions options;
  options.noise_level_dbfs = -120.0;
  return options;
}

std::string refusal(const MicrophoneMixerOptions& options)
{
  try
  {
    MicrophoneMixer mixer(options);
  }
  catch (const std::exception& error)
  {
    return error.what();
  }
  return "";
}

TEST(MicrophoneMixer, NoiseHasItsLevelAndIsTheSameForTheSameSeed)
{
  MicrophoneMixerOptions options;
  options.noise_level_dbfs = -50.0;
  MicrophoneMixer first(options);
  MicrophoneMixer same(options);
  options.seed = 2;
  MicrophoneMixer other(options);
  const Samples samples = first.next(160000);
  EXPECT_EQ(samples, same.next(160000));
  EXPECT_NE(samples, other.next(160000));
  EXPECT_NEAR(-50.0, levelDbfs(samples), 1.5);  // pink: its slow parts differ between 10 s
}

TEST(MicrophoneMixer, PlaysFromTheNextSampleOnAndTellsWhere)
{
  MicrophoneMixer mixer(silent());
  mixer.next(100);
  const Samples sound = toneIn(1000, 0, 1000);
  const SoundPlace place = mixer.play(sound);
  EXPECT_EQ(100, place.begin);
  EXPECT_EQ(1100, place.end);
  Samples heard = mixer.next(320);
  const Samples rest = mixer.next(1000);
  heard.insert(heard.end(), rest.begin(), rest.end());
  for (size_t i = 0; i < heard.size(); ++i)
  {
    ASSERT_NEAR(i < sound.size() ? sound[i] : 0, heard[i], 1) << i;
  }
  EXPECT_EQ(1420, mixer.position());
}

TEST(MicrophoneMixer, SoundsThatOverlapAddUpAndAreClippedAtFullScale)
{
  MicrophoneMixer mixer(silent());
  mixer.play(Samples(400, 20000));
  mixer.next(200);
  mixer.play(Samples(400, 20000));
  const Samples both = mixer.next(400);
  EXPECT_EQ(32767, both[0]);
  EXPECT_EQ(32767, both[199]);
  EXPECT_NEAR(20000, both[200], 1);
}

TEST(MicrophoneMixer, GainChangesWhatIsPlayed)
{
  MicrophoneMixerOptions options = silent();
  options.play_gain_db = -20.0;
  MicrophoneMixer mixer(options);
  mixer.play(Samples(100, 10000));
  EXPECT_NEAR(1000, mixer.next(100)[50], 1);
}

TEST(MicrophoneMixer, LoopsABackgroundAtItsLevel)
{
  const pi_node::test_support::TemporaryFolder folder;
  MicrophoneMixerOptions options = silent();
  options.background = folder.path() + "/hum.wav";
  options.background_level_dbfs = -40.0;
  pi_speech::writeWav(options.background, toneIn(4000, 0, 4000, 30000.0));
  MicrophoneMixer mixer(options);
  const Samples once = mixer.next(4000);
  EXPECT_NEAR(-40.0, levelDbfs(once), 0.2);
  const Samples again = mixer.next(4000);
  for (size_t i = 0; i < once.size(); ++i)
  {
    ASSERT_NEAR(once[i], again[i], 1) << "sample " << i;  // the noise below it is half a step
  }
}

TEST(MicrophoneMixer, NamesWhatIsWrong)
{
  MicrophoneMixerOptions options;
  options.noise_level_dbfs = 3.0;
  EXPECT_EQ("noise_level_dbfs = 3, must be in [-120, 0]", refusal(options));
  options = MicrophoneMixerOptions();
  options.background = "/nowhere/hum.wav";
  EXPECT_EQ("sound file /nowhere/hum.wav: cannot be opened: No such file or directory", refusal(options));
}

TEST(MicrophoneMixer, NoiseBehindTheSpeechDoesNotCount)
{
  MicrophoneMixerOptions options;
  options.noise_level_dbfs = -45.0;
  MicrophoneMixer mixer(options);
  mixer.play(toneIn(16000, 4000, 8000));
  EXPECT_EQ(8000u, pi_speech::endOfSpeech(mixer.next(16000)));
}

TEST(MicrophoneMixer, SoundTooShortToJudgeCountsWhole)
{
  MicrophoneMixer mixer(silent());
  const SoundPlace place = mixer.play({});
  EXPECT_EQ(place.begin, place.end);
  EXPECT_EQ(10u, mixer.next(10).size());
}

}  // namespace
}  // namespace pi_simulation
