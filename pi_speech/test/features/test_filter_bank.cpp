#include <gtest/gtest.h>
#include <pi_speech/filter_bank.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "audio/sound_bytes.h"
#include "audio/synthetic_sounds.h"

namespace pi_speech
{
namespace
{

/// Middle of a band, from the header's words: triangles even in mel scale from 60 to 7600 Hz.
double middleHz(int band)
{
  const auto mel = [](double hz) { return 2595.0 * std::log10(1.0 + hz / 700.0); };
  const double step = (mel(7600.0) - mel(60.0)) / (BANDS + 1);
  return 700.0 * (std::pow(10.0, (mel(60.0) + (band + 1) * step) / 2595.0) - 1.0);
}

TEST(FilterBank, ASineLandsInTheBandOfItsFrequency)
{
  FilterBank bank;
  for (int band = 0; band < BANDS; ++band)
  {
    const Samples samples = sine(middleHz(band), 8000.0, 0.025, SAMPLE_RATE_HZ);
    ASSERT_EQ(static_cast<size_t>(FRAME_SAMPLES), samples.size());

    const BandEnergies energies = bank.energies(samples.data());

    int loudest = 0;
    energies.maxCoeff(&loudest);
    EXPECT_EQ(band, loudest) << middleHz(band) << " Hz";
    // The window keeps the sine out of bands that are far from it.
    for (int other = 0; other < BANDS; ++other)
    {
      if (std::abs(other - band) > 3)
      {
        EXPECT_LT(energies[other], energies[band] - 4.0F) << band << ", " << other;
      }
    }
  }
}

TEST(FilterBank, TwiceTheAmplitudeIsFourTimesTheEnergy)
{
  FilterBank bank;
  const Samples quiet = whiteNoise(0.025, 1000.0);
  Samples loud = quiet;
  std::for_each(loud.begin(), loud.end(), [](int16_t& sample) { sample = static_cast<int16_t>(2 * sample); });

  const BandEnergies difference = bank.energies(loud.data()) - bank.energies(quiet.data());

  EXPECT_NEAR(std::log(4.0F), difference.minCoeff(), 1e-3F);
  EXPECT_NEAR(std::log(4.0F), difference.maxCoeff(), 1e-3F);
}

TEST(FilterBank, SilenceAndFullScaleAreFinite)
{
  FilterBank bank;
  const Samples silence(FRAME_SAMPLES, 0);
  Samples full(FRAME_SAMPLES);
  for (size_t i = 0; i < full.size(); ++i)
  {
    full[i] = i % 2 == 0 ? INT16_MIN : INT16_MAX;
  }
  Samples step(FRAME_SAMPLES, 0);
  step[FRAME_SAMPLES / 2] = 1;

  const BandEnergies of_silence = bank.energies(silence.data());

  EXPECT_TRUE(of_silence.allFinite());
  EXPECT_TRUE(bank.energies(full.data()).allFinite());
  // One step of one sample is hardly more than the floor: it must not look like a change of the sound.
  EXPECT_LT((bank.energies(step.data()) - of_silence).maxCoeff(), 1.0F);
  EXPECT_GT(bank.energies(full.data()).maxCoeff(), of_silence.maxCoeff() + 10.0F);
}

TEST(FilterBank, WhatWasBeforeDoesNotMatter)
{
  FilterBank bank;
  const Samples first = whiteNoise(0.025, 1000.0, 1);
  const Samples second = whiteNoise(0.025, 5000.0, 2);
  const BandEnergies expected = bank.energies(first.data());

  bank.energies(second.data());

  EXPECT_EQ(expected, bank.energies(first.data()));
}

TEST(FilterBank, CountsWholeFrames)
{
  EXPECT_EQ(0U, framesOf(0));
  EXPECT_EQ(0U, framesOf(FRAME_SAMPLES - 1));
  EXPECT_EQ(1U, framesOf(FRAME_SAMPLES));
  EXPECT_EQ(1U, framesOf(FRAME_SAMPLES + HOP_SAMPLES - 1));
  EXPECT_EQ(2U, framesOf(FRAME_SAMPLES + HOP_SAMPLES));
}

}  // namespace
}  // namespace pi_speech
