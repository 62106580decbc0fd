#include <gtest/gtest.h>
#include <pi_speech/end_pointer.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "audio/synthetic_sounds.h"

namespace pi_speech
{
namespace
{

using Event = EndPointer::Event;

constexpr double NOISE = 30.0;  ///< deviation of the noise: -61 dB of full scale
constexpr double VOICE = 300.0;
/// A frame sees 25 ms, and the first or last that sees enough of a sound may lie one frame beside it.
constexpr double EDGE_TOLERANCE_S = 0.035;

struct Told
{
  Event event;
  Utterance utterance;
  int64_t at;  ///< samples that had come
};

/// All times and thresholds, so that the tests hold whatever the defaults are.
EndPointerOptions testOptions()
{
  EndPointerOptions options;
  options.begin_threshold = 0.9;
  options.end_threshold = 0.55;
  options.min_level_dbfs = -65.0;
  options.min_speech_s = 0.08;
  options.end_silence_s = 0.22;
  options.early_silence_s = 0.10;
  options.tail_s = 0.10;
  options.lead_s = 0.20;
  options.max_utterance_s = 5.0;
  return options;
}

/// An end-pointer with all that it tells.
struct Recorder
{
  std::vector<Told> told;
  EndPointer end_pointer;

  explicit Recorder(const EndPointerOptions& options = testOptions())
    : end_pointer(options,
                  [this](Event event, const Utterance& utterance) {
                    told.push_back({event, utterance, end_pointer.samplesSeen()});
                  })
  {
  }

  void process(const Samples& samples, size_t chunk = HOP_SAMPLES)
  {
    for (size_t i = 0; i < samples.size(); i += chunk)
    {
      end_pointer.process(samples.data() + i, std::min(chunk, samples.size() - i));
    }
  }
};

std::vector<Told> eventsOf(const Samples& samples, const EndPointerOptions& options = testOptions(),
                           size_t chunk = HOP_SAMPLES)
{
  Recorder recorder(options);
  recorder.process(samples, chunk);
  return recorder.told;
}

std::vector<Told> only(Event event, const std::vector<Told>& all)
{
  std::vector<Told> result;
  std::copy_if(all.begin(), all.end(), std::back_inserter(result), [=](const Told& t) { return t.event == event; });
  return result;
}

double seconds(int64_t samples)
{
  return static_cast<double>(samples) / SAMPLE_RATE_HZ;
}

std::string errorOf(const std::function<void(EndPointerOptions*)>& change)
{
  EndPointerOptions options;
  change(&options);
  try
  {
    options.validate();
    return "";
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
}

TEST(EndPointer, TellsWhereSpeechBeginsPausesAndEnds)
{
  Samples samples = whiteNoise(4.0, NOISE);
  addTones(&samples, 1.0, 1.5, VOICE);
  addTones(&samples, 2.5, 2.8, VOICE);
  const EndPointerOptions options = testOptions();

  const std::vector<Told> told = eventsOf(samples);

  ASSERT_EQ(6U, told.size());
  const double begins[] = {1.0, 2.5};
  const double ends[] = {1.5, 2.8};
  for (size_t u = 0; u < 2; ++u)
  {
    const Told& begin = told[3 * u];
    const Told& pause = told[3 * u + 1];
    const Told& end = told[3 * u + 2];
    EXPECT_EQ(Event::BEGIN, begin.event);
    EXPECT_EQ(Event::PAUSE, pause.event);
    EXPECT_EQ(Event::END, end.event);
    EXPECT_NEAR(begins[u] + options.min_speech_s, seconds(begin.at), EDGE_TOLERANCE_S);
    EXPECT_NEAR(ends[u] + options.early_silence_s, seconds(pause.at), EDGE_TOLERANCE_S);
    EXPECT_NEAR(ends[u] + options.end_silence_s, seconds(end.at), EDGE_TOLERANCE_S);
    for (const Told& each : {begin, pause, end})
    {
      EXPECT_NEAR(begins[u], seconds(each.utterance.speech_begin), EDGE_TOLERANCE_S);
    }
    for (const Told& each : {pause, end})
    {
      EXPECT_NEAR(ends[u], seconds(each.utterance.speech_end), EDGE_TOLERANCE_S);
    }
    EXPECT_FALSE(end.utterance.cut);
  }
}

TEST(EndPointer, AnUtteranceHasItsSamplesFromTheLeadToTheTail)
{
  Samples samples = whiteNoise(3.0, NOISE);
  addTones(&samples, 1.0, 1.5, VOICE);
  EndPointerOptions options = testOptions();
  options.tail_s = 0.05;

  const std::vector<Told> told = eventsOf(samples, options);

  ASSERT_EQ(3U, told.size());
  const Utterance& utterance = told[2].utterance;
  EXPECT_EQ(static_cast<int64_t>(samplesIn(options.lead_s)), utterance.speech_begin - utterance.begin);
  EXPECT_EQ(utterance.speech_end + static_cast<int64_t>(samplesIn(options.tail_s)),
            utterance.begin + static_cast<int64_t>(utterance.samples.size()));
  EXPECT_TRUE(std::equal(utterance.samples.begin(), utterance.samples.end(), samples.begin() + utterance.begin));
  // What was decided at the pause holds at the end.
  EXPECT_EQ(Event::PAUSE, told[1].event);
  EXPECT_EQ(told[1].utterance.samples, utterance.samples);
}

TEST(EndPointer, SpeechAtTheBeginningOfTheStreamHasTheLeadThatThereIs)
{
  Samples samples = whiteNoise(1.5, NOISE);
  addTones(&samples, 0.13, 0.6, VOICE);

  const std::vector<Told> ends = only(Event::END, eventsOf(samples));

  ASSERT_EQ(1U, ends.size());
  EXPECT_EQ(0, ends[0].utterance.begin);
  EXPECT_NEAR(0.13, seconds(ends[0].utterance.speech_begin), EDGE_TOLERANCE_S);
}

TEST(EndPointer, SaysHowFarSpeechIsAboveTheNoise)
{
  Samples samples = whiteNoise(3.0, NOISE);
  addTones(&samples, 1.0, 1.5, VOICE);
  // Power of 58 harmonics and of the noise.
  const double expected = 10.0 * std::log10(58.0 * VOICE * VOICE / 2.0 / (NOISE * NOISE));

  const std::vector<Told> ends = only(Event::END, eventsOf(samples));

  // The frames at the edges are quieter, and the noise's estimate leans to its quiet frames.
  ASSERT_EQ(1U, ends.size());
  EXPECT_NEAR(expected, ends[0].utterance.snr_db, 2.0);
}

TEST(EndPointer, KnowsTheLevelOfTheNoise)
{
  EndPointer end_pointer(testOptions(), [](Event, const Utterance&) {});
  const Samples samples = whiteNoise(2.0, 100.0);

  end_pointer.process(samples.data(), samples.size());

  EXPECT_NEAR(20.0 * std::log10(100.0 / 32768.0), end_pointer.noiseLevelDbfs(), 1.0);
  EXPECT_EQ(static_cast<int64_t>(samples.size()), end_pointer.samplesSeen());
  EXPECT_FALSE(end_pointer.inSpeech());
}

TEST(EndPointer, ClicksAreNoSpeech)
{
  Samples samples = whiteNoise(5.0, NOISE);
  for (int i = 0; i < 8; ++i)
  {
    // 5 to 40 ms; with the length of a frame less than min_speech_s.
    const double begin = 0.5 + 0.5 * i;
    addTones(&samples, begin, begin + 0.005 * (i + 1), 500.0);
  }

  EXPECT_TRUE(only(Event::END, eventsOf(samples)).empty());
}

TEST(EndPointer, AClickBesideSpeechDoesNotHideIt)
{
  Samples samples = whiteNoise(4.0, NOISE);
  addTones(&samples, 0.6, 0.61, 500.0);
  addTones(&samples, 1.5, 2.0, VOICE);

  const std::vector<Told> ends = only(Event::END, eventsOf(samples));

  ASSERT_EQ(1U, ends.size());
  EXPECT_NEAR(1.5, seconds(ends[0].utterance.speech_begin), EDGE_TOLERANCE_S);
}

TEST(EndPointer, NoiseAndSilenceAreNoSpeech)
{
  EXPECT_TRUE(eventsOf(whiteNoise(10.0, 30.0)).empty());
  EXPECT_TRUE(eventsOf(whiteNoise(10.0, 3000.0)).empty());
  EXPECT_TRUE(eventsOf(Samples(samplesIn(10.0), 0)).empty());
}

TEST(EndPointer, SoundBelowTheLeastLevelIsNoSpeech)
{
  // The tones have 58 harmonics: -74 and -54 dB of full scale.
  Samples samples(samplesIn(3.0), 0);
  addTones(&samples, 1.0, 1.5, 1.2);
  Samples louder(samplesIn(3.0), 0);
  addTones(&louder, 1.0, 1.5, 12.0);

  EXPECT_TRUE(eventsOf(samples).empty());
  EXPECT_EQ(1U, only(Event::END, eventsOf(louder)).size());
}

TEST(EndPointer, AHumThatSetsInBecomesNoise)
{
  Samples samples = whiteNoise(12.0, NOISE);
  addTones(&samples, 1.0, 12.0, 60.0, 100.0);
  addTones(&samples, 10.0, 10.5, 700.0);
  EndPointerOptions options = testOptions();
  options.max_utterance_s = 4.0;

  const std::vector<Told> ends = only(Event::END, eventsOf(samples, options));

  ASSERT_EQ(2U, ends.size());
  EXPECT_FALSE(ends[0].utterance.cut);
  EXPECT_NEAR(1.0, seconds(ends[0].utterance.speech_begin), EDGE_TOLERANCE_S);
  EXPECT_LT(seconds(ends[0].at), 3.5) << "what the bands do not fall below for more than a second is noise";
  EXPECT_FALSE(ends[1].utterance.cut);
  EXPECT_NEAR(10.0, seconds(ends[1].utterance.speech_begin), EDGE_TOLERANCE_S);
  EXPECT_NEAR(10.5, seconds(ends[1].utterance.speech_end), EDGE_TOLERANCE_S);
}

TEST(EndPointer, WordsInNoiseThatFluctuatesAreFoundAndEnd)
{
  // As in rain: each piece of 15 ms has another level.
  Samples samples = whiteNoise(30.0, 400.0);
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  double gain = 1.0;
  for (size_t i = 0; i < samples.size(); ++i)
  {
    gain = i % 240 == 0 ? std::exp(0.6 * normal(random)) : gain;
    samples[i] = toSample(gain * samples[i]);
  }
  for (int word = 0; word < 10; ++word)
  {
    addTones(&samples, 5.0 + 2.5 * word, 5.5 + 2.5 * word, 900.0);
  }

  const std::vector<Told> ends = only(Event::END, eventsOf(samples));

  int found = 0;
  for (const Told& end : ends)
  {
    EXPECT_FALSE(end.utterance.cut);
    const double since = std::fmod(seconds(end.utterance.speech_begin), 2.5);
    found += std::min(since, 2.5 - since) < 0.15 &&
                     seconds(end.utterance.speech_end - end.utterance.speech_begin) < 0.9 &&
                     seconds(end.utterance.speech_begin) > 4.0
                 ? 1
                 : 0;
  }
  EXPECT_GE(found, 9);
  EXPECT_LE(ends.size(), 14U);
}

TEST(EndPointer, SpeechWithoutEndIsCut)
{
  Samples samples = whiteNoise(3.0, NOISE);
  addTones(&samples, 0.5, 2.5, VOICE);
  EndPointerOptions options = testOptions();
  options.max_utterance_s = 1.0;

  const std::vector<Told> ends = only(Event::END, eventsOf(samples, options));

  ASSERT_FALSE(ends.empty());
  EXPECT_TRUE(ends[0].utterance.cut);
  EXPECT_NEAR(1.5, seconds(ends[0].at), EDGE_TOLERANCE_S);
  EXPECT_NEAR(1.5, seconds(ends[0].utterance.speech_end), EDGE_TOLERANCE_S);
}

TEST(EndPointer, AShortPauseDoesNotEndAnUtterance)
{
  Samples samples = whiteNoise(3.0, NOISE);
  addTones(&samples, 1.0, 1.3, VOICE);
  addTones(&samples, 1.45, 1.8, VOICE);

  const std::vector<Told> told = eventsOf(samples);

  ASSERT_EQ(4U, told.size());
  EXPECT_EQ(Event::BEGIN, told[0].event);
  EXPECT_EQ(Event::PAUSE, told[1].event);
  EXPECT_NEAR(1.3, seconds(told[1].utterance.speech_end), EDGE_TOLERANCE_S);
  EXPECT_EQ(Event::PAUSE, told[2].event);
  EXPECT_EQ(Event::END, told[3].event);
  EXPECT_NEAR(1.0, seconds(told[3].utterance.speech_begin), EDGE_TOLERANCE_S);
  EXPECT_NEAR(1.8, seconds(told[3].utterance.speech_end), EDGE_TOLERANCE_S);
}

TEST(EndPointer, WithoutEarlySilenceNoPauseIsTold)
{
  Samples samples = whiteNoise(2.5, NOISE);
  addTones(&samples, 1.0, 1.5, VOICE);
  EndPointerOptions options = testOptions();
  options.early_silence_s = 0.0;

  const std::vector<Told> told = eventsOf(samples, options);

  ASSERT_EQ(2U, told.size());
  EXPECT_EQ(Event::BEGIN, told[0].event);
  EXPECT_EQ(Event::END, told[1].event);
}

TEST(EndPointer, SpeechInProgressMayBeQuieterThanSpeechThatBegins)
{
  // White noise 1.1 (ln of energy) above the rest: between both thresholds. It scatters, so that the gap is wide.
  EndPointerOptions options = testOptions();
  options.begin_threshold = 1.6;
  options.end_threshold = 0.5;
  const double quiet = NOISE * std::sqrt(std::exp(1.1) - 1.0);
  const auto addQuiet = [&](Samples* samples, double begin_s, double end_s)
  {
    const Samples more = whiteNoise(end_s - begin_s, quiet, 7);
    for (size_t i = 0; i < more.size(); ++i)
    {
      int16_t& sample = (*samples)[samplesIn(begin_s) + i];
      sample = toSample(sample + more[i]);
    }
  };
  Samples alone = whiteNoise(3.0, NOISE);
  addQuiet(&alone, 1.0, 1.8);
  Samples behind_speech = whiteNoise(3.0, NOISE);
  addTones(&behind_speech, 0.85, 1.0, 100.0);  // the noise learns little of it
  addQuiet(&behind_speech, 1.0, 1.8);

  EXPECT_TRUE(eventsOf(alone, options).empty());
  const std::vector<Told> ends = only(Event::END, eventsOf(behind_speech, options));
  ASSERT_EQ(1U, ends.size());
  EXPECT_NEAR(1.8, seconds(ends[0].utterance.speech_end), 0.1);
}

TEST(EndPointer, TheSizeOfTheChunksDoesNotMatter)
{
  Samples samples = whiteNoise(12.0, NOISE);
  addTones(&samples, 1.0, 1.5, VOICE);
  addTones(&samples, 2.5, 2.8, VOICE);
  addTones(&samples, 5.0, 11.0, VOICE);
  const std::vector<Told> expected = eventsOf(samples);
  ASSERT_GE(expected.size(), 8U);

  for (const size_t chunk : {size_t{7}, size_t{999}, size_t{4096}, samples.size()})
  {
    const std::vector<Told> told = eventsOf(samples, testOptions(), chunk);
    ASSERT_EQ(expected.size(), told.size()) << chunk;
    for (size_t i = 0; i < told.size(); ++i)
    {
      EXPECT_EQ(expected[i].event, told[i].event);
      EXPECT_EQ(expected[i].utterance.begin, told[i].utterance.begin);
      EXPECT_EQ(expected[i].utterance.speech_begin, told[i].utterance.speech_begin);
      EXPECT_EQ(expected[i].utterance.speech_end, told[i].utterance.speech_end);
      EXPECT_EQ(expected[i].utterance.snr_db, told[i].utterance.snr_db);
      EXPECT_EQ(expected[i].utterance.cut, told[i].utterance.cut);
      EXPECT_EQ(expected[i].utterance.samples, told[i].utterance.samples) << chunk << ", event " << i;
    }
  }
}

TEST(EndPointer, FlushEndsAnUtteranceInProgress)
{
  Samples samples = whiteNoise(1.5, NOISE);
  addTones(&samples, 1.0, 1.5, VOICE);
  Recorder recorder;
  EndPointer& end_pointer = recorder.end_pointer;
  std::vector<Told>& told = recorder.told;
  recorder.process(samples);
  ASSERT_TRUE(end_pointer.inSpeech());
  ASSERT_TRUE(only(Event::END, told).empty());

  end_pointer.flush();

  const std::vector<Told> ends = only(Event::END, told);
  ASSERT_EQ(1U, ends.size());
  EXPECT_FALSE(ends[0].utterance.cut);
  EXPECT_NEAR(1.5, seconds(ends[0].utterance.speech_end), EDGE_TOLERANCE_S);
  EXPECT_FALSE(end_pointer.inSpeech());
  end_pointer.flush();
  EXPECT_EQ(1U, only(Event::END, told).size());
}

TEST(EndPointer, FlushKeepsTheNoiseAndTheTime)
{
  Recorder recorder;
  EndPointer& end_pointer = recorder.end_pointer;
  std::vector<Told>& told = recorder.told;
  const Samples noise = whiteNoise(2.0, NOISE);
  end_pointer.process(noise.data(), noise.size());
  const double level = end_pointer.noiseLevelDbfs();

  end_pointer.flush();

  EXPECT_TRUE(told.empty());
  EXPECT_EQ(level, end_pointer.noiseLevelDbfs());
  Samples speech = whiteNoise(1.0, NOISE, 2);
  addTones(&speech, 0.05, 0.5, VOICE);
  recorder.process(speech);
  const std::vector<Told> ends = only(Event::END, told);
  ASSERT_EQ(1U, ends.size());
  EXPECT_NEAR(2.05, seconds(ends[0].utterance.speech_begin), EDGE_TOLERANCE_S);
}

TEST(EndPointer, ResetForgetsAnUtteranceAndTheNoise)
{
  Samples samples = whiteNoise(2.5, NOISE);
  addTones(&samples, 1.0, 1.5, VOICE);
  const std::vector<Told> expected = eventsOf(samples);
  Recorder recorder;
  EndPointer& end_pointer = recorder.end_pointer;
  std::vector<Told>& told = recorder.told;
  Samples before = whiteNoise(1.37, 1000.0);
  addTones(&before, 1.0, 1.37, 3000.0);
  recorder.process(before);
  ASSERT_TRUE(end_pointer.inSpeech());
  told.clear();

  end_pointer.reset();

  EXPECT_TRUE(told.empty());
  EXPECT_FALSE(end_pointer.inSpeech());
  EXPECT_EQ(0, end_pointer.samplesSeen());
  recorder.process(samples);
  ASSERT_EQ(expected.size(), told.size());
  EXPECT_EQ(expected.back().utterance.speech_begin, told.back().utterance.speech_begin);
  EXPECT_EQ(expected.back().utterance.speech_end, told.back().utterance.speech_end);
  EXPECT_EQ(expected.back().utterance.snr_db, told.back().utterance.snr_db);
  EXPECT_EQ(expected.back().utterance.samples, told.back().utterance.samples);
}

TEST(EndPointer, AnEndAlwaysHasABeginning)
{
  // Speech that is cut before it is long enough to be speech.
  Samples samples = whiteNoise(4.0, NOISE);
  addTones(&samples, 0.5, 3.0, VOICE);
  EndPointerOptions options = testOptions();
  options.max_utterance_s = 0.5;
  options.min_speech_s = 0.9;
  std::vector<Told> told;
  try
  {
    told = eventsOf(samples, options);
  }
  catch (const std::invalid_argument&)
  {
    return;  // such options may be refused
  }

  bool begun = false;
  for (const Told& each : told)
  {
    EXPECT_NE(each.event == Event::BEGIN, begun);
    begun = each.event == Event::END ? false : (each.event == Event::BEGIN || begun);
  }
}

TEST(EndPointer, BadOptionsAreNamed)
{
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ("", errorOf([](EndPointerOptions*) {}));
  EXPECT_EQ(0U, errorOf([](auto* o) { o->begin_threshold = 0.0; }).find("begin_threshold = 0, must be in ["));
  EXPECT_EQ(0U, errorOf([=](auto* o) { o->begin_threshold = nan; }).find("begin_threshold = "));
  EXPECT_EQ(0U, errorOf([](auto* o) { o->end_threshold = o->begin_threshold + 1.0; }).find("end_threshold = "));
  EXPECT_EQ(0U, errorOf([](auto* o) { o->min_level_dbfs = 1.0; }).find("min_level_dbfs = 1, must be in ["));
  EXPECT_EQ(0U, errorOf([](auto* o) { o->min_speech_s = 0.0; }).find("min_speech_s = 0, must be in ["));
  EXPECT_EQ(0U, errorOf([](auto* o) { o->end_silence_s = 0.0; }).find("end_silence_s = 0, must be in ["));
  EXPECT_EQ(0U, errorOf([](auto* o) { o->early_silence_s = 4.0; }).find("early_silence_s = "));
  EXPECT_EQ(0U, errorOf([](auto* o) { o->lead_s = -1.0; }).find("lead_s = -1, must be in ["));
  EXPECT_EQ(0U, errorOf([=](auto* o) { o->max_utterance_s = nan; }).find("max_utterance_s = "));
  EndPointerOptions bad;
  bad.lead_s = -1.0;
  EXPECT_THROW(EndPointer(bad, [](Event, const Utterance&) {}), std::invalid_argument);
}

}  // namespace
}  // namespace pi_speech
