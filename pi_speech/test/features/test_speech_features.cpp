#include <gtest/gtest.h>
#include <pi_speech/filter_bank.h>
#include "features/speech_features.h"

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

/// Sound whose frames are the same but for their loudness, which grows exponentially: its tones repeat with each hop.
Samples growingTones(double seconds, double nepers_per_s)
{
  Samples samples(samplesIn(seconds));
  for (size_t i = 0; i < samples.size(); ++i)
  {
    const double t = static_cast<double>(i) / SAMPLE_RATE_HZ;
    double sum = 0.0;
    for (int harmonic = 1; harmonic <= 75; ++harmonic)
    {
      sum += std::sin(2.0 * M_PI * 100.0 * harmonic * t + harmonic * harmonic);
    }
    samples[i] = toSample(100.0 * std::exp(nepers_per_s * t) * sum);
  }
  return samples;
}

FeatureMatrix featuresOf(const Samples& samples)
{
  return SpeechFeatures().compute(samples.data(), samples.size());
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

TEST(SpeechFeatures, HasARowPerWholeFrame)
{
  SpeechFeatures features;
  const Samples samples = whiteNoise(1.0, 1000.0);
  EXPECT_EQ(0, features.compute(nullptr, 0).rows());
  for (const size_t count : {size_t{1}, size_t{399}, size_t{400}, size_t{559}, size_t{560}, samples.size()})
  {
    const FeatureMatrix rows = features.compute(samples.data(), count);
    EXPECT_EQ(static_cast<Eigen::Index>(framesOf(count)), rows.rows());
    EXPECT_EQ(FEATURES, rows.cols());
    EXPECT_TRUE(rows.allFinite());
  }
}

TEST(SpeechFeatures, ASingleFrameIsItsOwnMean)
{
  const Samples samples = whiteNoise(0.025, 1000.0);

  const FeatureMatrix features = featuresOf(samples);

  ASSERT_EQ(1, features.rows());
  EXPECT_LT(features.cwiseAbs().maxCoeff(), 1e-4F);
}

TEST(SpeechFeatures, CepstraHaveMeanZero)
{
  Samples samples = whiteNoise(1.0, 300.0);
  addTones(&samples, 0.3, 0.7, 200.0);

  const FeatureMatrix features = featuresOf(samples);

  const auto means = features.leftCols<CEPSTRA>().colwise().mean();
  const float spread = features.col(0).maxCoeff() - features.col(0).minCoeff();
  EXPECT_GT(spread, 1.0F);
  EXPECT_LT(means.cwiseAbs().maxCoeff(), 1e-4F * spread);
}

TEST(SpeechFeatures, LoudnessDoesNotMatter)
{
  Samples loud = whiteNoise(1.0, 1000.0);
  addTones(&loud, 0.3, 0.7, 200.0);
  Samples quiet(loud.size());
  std::transform(loud.begin(), loud.end(), quiet.begin(), [](int16_t sample) { return toSample(sample / 4.0); });

  const FeatureMatrix difference = featuresOf(loud) - featuresOf(quiet);

  // Rounding to steps adds noise of 0.3 steps to noise of 250: e^-13 of the power, more in the quietest bands.
  EXPECT_LT(difference.cwiseAbs().maxCoeff(), 0.02F);
}

TEST(SpeechFeatures, CepstraTellSoundsApart)
{
  Samples samples = sine(500.0, 8000.0, 0.5, SAMPLE_RATE_HZ);
  const Samples other = sine(3000.0, 8000.0, 0.5, SAMPLE_RATE_HZ);
  samples.insert(samples.end(), other.begin(), other.end());

  const FeatureMatrix features = featuresOf(samples);

  const auto cepstra = features.leftCols<CEPSTRA>();
  const float within = (cepstra.row(10) - cepstra.row(30)).norm();
  const float between = (cepstra.row(10) - cepstra.row(80)).norm();
  EXPECT_GT(between, 10.0F * within);
}

TEST(SpeechFeatures, SlopesAreThoseOfARamp)
{
  constexpr double GROWTH = 4.0;  ///< nepers per second
  const FeatureMatrix features = featuresOf(growingTones(0.6, GROWTH));
  // The ln of each band's energy grows by twice the nepers per frame; c0 of an orthonormal transform is their sum over
  // the root of their number.
  const double slope = 2.0 * GROWTH * FRAME_S * std::sqrt(static_cast<double>(BANDS));
  const Eigen::Index frames = features.rows();
  ASSERT_GT(frames, 40);

  for (Eigen::Index t = 4; t < frames - 4; ++t)
  {
    // Tolerances: rounding to steps in the quiet part.
    EXPECT_NEAR(slope, features(t, CEPSTRA), 0.02 * slope) << t;
    EXPECT_NEAR(0.0, features(t, 2 * CEPSTRA), 0.01 * slope) << t;
    for (int c = 1; c < CEPSTRA; ++c)
    {
      EXPECT_NEAR(0.0, features(t, CEPSTRA + c), 0.02 * slope) << t << ", " << c;
    }
  }
  // The middle frame is at the mean.
  EXPECT_NEAR(0.0, 0.5 * (features(0, 0) + features(frames - 1, 0)), 0.05 * slope * static_cast<double>(frames));
  EXPECT_NEAR(slope * static_cast<double>(frames - 1), features(frames - 1, 0) - features(0, 0),
              0.02 * slope * static_cast<double>(frames));
}

}  // namespace
}  // namespace pi_speech
