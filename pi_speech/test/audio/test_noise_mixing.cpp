#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <set>
#include <string>

#include "clips/noisy_clips.h"

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

Samples tone(size_t count, double amplitude, double hz = 440.0)
{
  Samples samples(count);
  for (size_t i = 0; i < count; ++i)
  {
    samples[i] = static_cast<int16_t>(
        std::lround(amplitude * std::sin(2.0 * M_PI * hz * static_cast<double>(i) / SAMPLE_RATE_HZ)));
  }
  return samples;
}

/// 0.3 s of tone in a second that is silent else.
Samples tonesInSilence(double amplitude)
{
  Samples samples(SAMPLE_RATE_HZ, 0);
  const Samples speech = tone(4800, amplitude);
  std::copy(speech.begin(), speech.end(), samples.begin() + 6400);
  return samples;
}

double meanSquare(const std::vector<double>& values)
{
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0) / static_cast<double>(values.size());
}

/// Power of the noise in a mix [dB relative to the clip's speech].
double snrOf(const Samples& clip, const Samples& mixed)
{
  std::vector<double> noise(clip.size());
  std::transform(clip.begin(), clip.end(), mixed.begin(), noise.begin(), [](int16_t a, int16_t b) { return b - a; });
  return 10.0 * std::log10(activePower(clip) / meanSquare(noise));
}

/// Power between two frequencies, from spectra of 1024 samples under a Hann window.
double bandPower(const std::vector<float>& samples, double low_hz, double high_hz)
{
  constexpr size_t SIZE = 1024;
  std::vector<double> cosine(SIZE);
  for (size_t i = 0; i < SIZE; ++i)
  {
    cosine[i] = std::cos(2.0 * M_PI * static_cast<double>(i) / SIZE);
  }
  double power = 0.0;
  for (size_t begin = 0; begin + SIZE <= samples.size(); begin += SIZE)
  {
    for (auto bin = static_cast<size_t>(low_hz * SIZE / SAMPLE_RATE_HZ);
         bin < static_cast<size_t>(high_hz * SIZE / SAMPLE_RATE_HZ); ++bin)
    {
      double re = 0.0;
      double im = 0.0;
      for (size_t i = 0; i < SIZE; ++i)
      {
        const double value = (0.5 - 0.5 * cosine[i]) * samples[begin + i];
        re += value * cosine[bin * i % SIZE];
        im += value * cosine[(bin * i + SIZE / 4) % SIZE];
      }
      power += re * re + im * im;
    }
  }
  return power;
}

std::string messageOf(const std::function<void()>& call)
{
  try
  {
    call();
  }
  catch (const std::exception& error)
  {
    return error.what();
  }
  return "";
}

TEST(NoiseMixing, PowerOfSpeechLeavesOutThePauses)
{
  // 6 of 20 pieces sound, and 6 are 30 %: the mean square of a sine of amplitude 1000.
  EXPECT_NEAR(activePower(tonesInSilence(1000.0)), 500000.0, 1000.0);
  EXPECT_NEAR(activePower(tone(400, 1000.0)), 500000.0, 1000.0);  // shorter than a piece
  EXPECT_EQ(activePower({}), 0.0);
  EXPECT_EQ(activePower(Samples(16000, 0)), 0.0);
}

TEST(NoiseMixing, MixHasTheRatioAskedFor)
{
  const Samples clip = tonesInSilence(3000.0);
  for (const char* name : {"white", "pink", "wind"})
  {
    for (const double snr_db : {20.0, 10.0, 0.0, -5.0})
    {
      NoiseSource noise(name, 3);
      // Rounding to samples adds 1/12 to a power of at least 4.5e4.
      EXPECT_NEAR(snrOf(clip, mixNoise(clip, noise.next(clip.size()), snr_db)), snr_db, 0.01) << name;
    }
  }
}

TEST(NoiseMixing, WhatIsBehindTheRecordingDoesNotCount)
{
  const Samples clip = tonesInSilence(3000.0);
  Samples longer = clip;
  longer.resize(3 * clip.size(), 0);
  NoiseSource noise("white", 3);
  Samples mixed = mixNoise(longer, noise.next(longer.size()), 10.0, clip.size());
  mixed.resize(clip.size());
  EXPECT_NEAR(snrOf(clip, mixed), 10.0, 0.01);
}

TEST(NoiseMixing, LoudMixIsMadeQuieterInsteadOfClipped)
{
  const Samples clip = tone(16000, 30000.0);
  NoiseSource noise("white", 1);
  const Samples mixed = mixNoise(clip, noise.next(clip.size()), 0.0);
  const auto extremes = std::minmax_element(mixed.begin(), mixed.end());
  EXPECT_EQ(std::max(-*extremes.first, 0 + *extremes.second), 32767);
  const auto at_edge = std::count_if(mixed.begin(), mixed.end(), [](int16_t s) { return std::abs(s) >= 32766; });
  EXPECT_LE(at_edge, 2);
}

TEST(NoiseMixing, SilentClipStaysSilent)
{
  const Samples silent(1000, 0);
  EXPECT_EQ(mixNoise(silent, std::vector<float>(1000, 1.0F), 10.0), silent);
}

TEST(NoiseMixing, WrongInputIsNamed)
{
  const Samples clip = tone(1000, 100.0);
  EXPECT_EQ(messageOf([&] { mixNoise(clip, std::vector<float>(999, 1.0F), 10.0); }),
            "mixNoise: 999 samples of noise, must be 1000, as the clip has");
  EXPECT_EQ(messageOf([&] { mixNoise(clip, std::vector<float>(1000, 0.0F), 10.0); }),
            "mixNoise: power of the noise = 0.000000, must be positive");
  EXPECT_EQ(messageOf([&] { mixNoise(clip, std::vector<float>(1000, 1.0F), std::nan("")); }),
            "snr_db = nan, must be in [-60, 100]");
}

TEST(NoiseSource, SameSeedGivesSameNoise)
{
  for (const char* name : {"white", "pink", "wind"})
  {
    NoiseSource a(name, 7);
    NoiseSource b(name, 7);
    NoiseSource c(name, 8);
    const std::vector<float> noise = a.next(1000);
    std::vector<float> pieces = b.next(400);
    const std::vector<float> rest = b.next(600);
    pieces.insert(pieces.end(), rest.begin(), rest.end());
    EXPECT_EQ(noise, pieces);
    EXPECT_NE(noise, c.next(1000));
  }
}

TEST(NoiseSource, PinkHasEqualPowerInOctavesAndWhiteTwiceAsMuchInTheNext)
{
  NoiseSource pink("pink", 5);
  NoiseSource white("white", 5);
  const std::vector<float> pink_noise = pink.next(1024 * 40);
  const std::vector<float> white_noise = white.next(1024 * 40);
  for (const double low_hz : {250.0, 500.0, 1000.0, 2000.0})
  {
    // 16 bins x 40 spectra in the least octave: 1 sigma is 4 % or 0.2 dB in each of the two.
    const auto step_db = [low_hz](const std::vector<float>& noise) {
      return 10.0 * std::log10(bandPower(noise, 2.0 * low_hz, 4.0 * low_hz) / bandPower(noise, low_hz, 2.0 * low_hz));
    };
    EXPECT_NEAR(step_db(pink_noise), 0.0, 1.2) << low_hz;
    EXPECT_NEAR(step_db(white_noise), 3.0, 1.2) << low_hz;
  }
}

TEST(NoiseSource, WindIsLowAndComesInGusts)
{
  NoiseSource wind("wind", 5);
  std::vector<double> seconds_db;
  std::vector<float> all;
  for (int second = 0; second < 60; ++second)
  {
    const std::vector<float> noise = wind.next(SAMPLE_RATE_HZ);
    seconds_db.push_back(10.0 * std::log10(meanSquare({noise.begin(), noise.end()})));
    all.insert(all.end(), noise.begin(), noise.end());
  }
  // Two poles: 12 dB per octave above the cut-off.
  EXPECT_NEAR(10.0 * std::log10(bandPower(all, 1000.0, 2000.0) / bandPower(all, 2000.0, 4000.0)), 9.0, 3.0);
  EXPECT_GT(bandPower(all, 0.0, 500.0), 10.0 * bandPower(all, 500.0, 8000.0));
  const auto [calm, gust] = std::minmax_element(seconds_db.begin(), seconds_db.end());
  EXPECT_GT(*gust - *calm, 6.0);
}

TEST(NoiseSource, FileIsLoopedFromAPlaceOfTheSeed)
{
  const TemporaryFolder folder;
  Samples ramp(100);
  std::iota(ramp.begin(), ramp.end(), int16_t{1});
  const std::string path = folder.path() + "/ramp.wav";
  writeWav(path, ramp);
  NoiseSource noise(path, 1);
  const std::vector<float> values = noise.next(250);
  for (size_t i = 1; i < values.size(); ++i)
  {
    EXPECT_EQ(values[i], values[i - 1] == 100.0F ? 1.0F : values[i - 1] + 1.0F);
  }
  std::set<float> begins;
  for (uint32_t seed = 0; seed < 8; ++seed)
  {
    begins.insert(NoiseSource(path, seed).next(1).front());
  }
  EXPECT_GT(begins.size(), 1U);
}

TEST(NoiseSource, FileWithoutSoundIsNamed)
{
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/none.wav";
  writeWav(path, Samples(100, 0));
  EXPECT_EQ(messageOf([&] { NoiseSource(path, 1); }),
            "noise " + path + ": there is only silence in this file; give another one");
  EXPECT_NE(messageOf([&] { NoiseSource(folder.path() + "/missing.wav", 1); }).find("missing.wav"), std::string::npos);
}

TEST(NoiseMixing, BackgroundIsTheQuietestPieceWithoutASpeechInIt)
{
  Samples clip = tone(16000, 2000.0);
  const Samples quiet = tone(3200, 20.0, 100.0);
  std::copy(quiet.begin(), quiet.end(), clip.begin() + 8000);
  const Samples background = continueBackground(clip, 10000);
  ASSERT_EQ(background.size(), 10000U);
  EXPECT_LE(*std::max_element(background.begin(), background.end()), 20);
  EXPECT_GE(*std::max_element(background.begin(), background.end()), 19);
  for (size_t i = 1; i < background.size(); ++i)
  {
    // The tone's own steepest step is 20 * 2 pi * 100 / 16000 = 0.8.
    ASSERT_LE(std::abs(background[i] - background[i - 1]), 1) << i;
  }
  EXPECT_EQ(continueBackground({}, 3), Samples(3, 0));
  EXPECT_EQ(continueBackground({1, 2}, 5), (Samples{1, 2, 2, 1, 1}));
}

}  // namespace
}  // namespace pi_speech
