#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/command_recognizer.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "audio/sound_bytes.h"
#include "audio/synthetic_sounds.h"
#include "clips/noisy_clips.h"

#include "recognizer/test_support.h"

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

namespace fs = std::filesystem;

const std::string GO_FORWARD = "/usr/share/pocketsphinx/test/data/goforward.raw";
constexpr size_t CHUNK = 320;  ///< 20 ms

std::string configFile(const std::string& name)
{
  return std::string(PI_SPEECH_CONFIG) + "/" + name;
}

/// The package's models. Loaded in this process: the check of the acoustic model has a test of its own.
RecognizerOptions optionsOf(RecognitionMode mode)
{
  RecognizerOptions options;
  options.mode = mode;
  options.garbage_words = configFile("garbage_words.txt");
  options.confidence = configFile("confidence.yaml");
  options.sphinx.adaptation = fs::exists(configFile("adaptation")) ? configFile("adaptation") : "";
  options.sphinx.check_model = false;
  options.end_pointer.early_silence_s = 0.10;
  options.sure_confidence = 1.0;  // only fast commands are told early
  return options;
}

struct Clip
{
  std::string path;
  std::string word;
};

/// Recordings of the ten words, other words and background; empty where there are none.
std::vector<Clip> allClips()
{
  const char* data = std::getenv("PI_EDGE_DATA");
  const std::string folder = data == nullptr ? "" : std::string(data) + "/speech/";
  std::ifstream list(folder + "commands.tsv");
  std::vector<Clip> clips;
  std::string line;
  std::getline(list, line);
  while (std::getline(list, line))
  {
    std::istringstream columns(line);
    Clip clip;
    columns >> clip.path >> clip.word;
    clip.path = folder + clip.path;
    clips.push_back(clip);
  }
  return clips;
}

/// Clips of one word, every so many, in the middle of a second of their room before and behind.
std::vector<Samples> spoken(const std::string& word, size_t count)
{
  std::vector<Samples> result;
  for (const Clip& clip : allClips())
  {
    if (clip.word == word && result.size() < count)
    {
      const Samples samples = readAudioFile(clip.path);
      Samples stream = continueBackground(samples, SAMPLE_RATE_HZ);
      const Samples room = stream;
      stream.insert(stream.end(), samples.begin(), samples.end());
      stream.insert(stream.end(), room.begin(), room.end());
      result.push_back(stream);
    }
  }
  return result;
}

/// Syllables of changing pitch and loudness in a row, with pauses too short to end an utterance.
Samples babble(double seconds)
{
  Samples samples = whiteNoise(seconds, 20.0);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> share;
  for (double at = 1.0; at < seconds - 1.0;)
  {
    const double length = 0.12 + 0.15 * share(random);
    const double pitch = 60.0 + 120.0 * share(random);
    addTones(&samples, at, at + length, pitch, 90.0 + 120.0 * share(random));
    at += length + 0.06 * share(random);
  }
  return samples;
}

std::vector<Recognition> recognitionsOf(CommandRecognizer* recognizer, const Samples& stream, size_t chunk = CHUNK)
{
  std::vector<Recognition> result;
  const CommandRecognizer::Sink sink = [&](const Recognition& recognition) { result.push_back(recognition); };
  recognizer->reset();
  for (size_t i = 0; i < stream.size(); i += chunk)
  {
    recognizer->process(stream.data() + i, std::min(chunk, stream.size() - i), sink);
  }
  recognizer->flush(sink);
  return result;
}

void expectSame(const Recognition& a, const Recognition& b)
{
  EXPECT_EQ(a.text, b.text);
  EXPECT_EQ(a.accepted, b.accepted);
  EXPECT_EQ(a.confidence, b.confidence);
  EXPECT_EQ(a.fast, b.fast);
  EXPECT_EQ(a.speech_begin, b.speech_begin);
  EXPECT_EQ(a.speech_end, b.speech_end);
  EXPECT_EQ(a.snr_db, b.snr_db);
}

std::string errorOf(const RecognizerOptions& options)
{
  try
  {
    CommandRecognizer recognizer(options, table("go, stop"));
    return "";
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
}

/// The ten words of the package, loaded once per mode.
class CommandRecognizerTest : public testing::Test
{
protected:
  void SetUp() override
  {
    if (!fs::exists(SphinxModel().acoustic_model))
    {
      GTEST_SKIP() << "no " << SphinxModel().acoustic_model << "; install pocketsphinx-en-us";
    }
  }
  static void TearDownTestSuite() { recognizers().clear(); }

  static CommandRecognizer& tenWords(RecognitionMode mode)
  {
    std::unique_ptr<CommandRecognizer>& recognizer = recognizers()[mode];
    if (!recognizer)
    {
      recognizer =
          std::make_unique<CommandRecognizer>(optionsOf(mode), CommandTable::load(configFile("commands.yaml")));
    }
    recognizer->reset();
    recognizer->setRunner([](double, const std::function<void()>& work) { work(); });
    recognizer->setUtteranceSink(nullptr);
    return *recognizer;
  }

private:
  static std::map<RecognitionMode, std::unique_ptr<CommandRecognizer>>& recognizers()
  {
    static std::map<RecognitionMode, std::unique_ptr<CommandRecognizer>> all;
    return all;
  }
};

#define SKIP_WITHOUT_CLIPS()                                                              \
  if (allClips().empty())                                                                 \
  {                                                                                       \
    GTEST_SKIP() << "no speech/commands.tsv in PI_EDGE_DATA: recordings of spoken words"; \
  }

TEST(RecognitionMode, HasNames)
{
  EXPECT_STREQ("safe", toString(RecognitionMode::SAFE));
  EXPECT_STREQ("closed", toString(RecognitionMode::CLOSED));
}

TEST(RecognizerOptions, BadOnesAreNamed)
{
  const auto error = [](const std::function<void(RecognizerOptions*)>& change)
  {
    RecognizerOptions options = optionsOf(RecognitionMode::SAFE);
    change(&options);
    try
    {
      options.validate();
      return std::string();
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
  };
  EXPECT_EQ("", error([](RecognizerOptions*) {}));
  EXPECT_EQ(0U, error([](auto* o) { o->threshold = 1.5; }).find("threshold = 1.5, must be in ["));
  EXPECT_EQ(0U, error([](auto* o) { o->threshold = std::nan(""); }).find("threshold = "));
  EXPECT_EQ(0U, error([](auto* o) { o->max_command_s = 0.0; }).find("max_command_s = 0, must be in ["));
  EXPECT_EQ(0U, error([](auto* o) { o->end_pointer.lead_s = -1.0; }).find("end_pointer/lead_s = -1, must be in ["));
  EXPECT_EQ(0U, error([](auto* o) { o->garbage_words = ""; }).find("garbage_words = "));
  EXPECT_EQ(0U, error([](auto* o) { o->confidence = ""; }).find("confidence = "));
}

TEST_F(CommandRecognizerTest, UnderstandsTheCommandsOfRecordings)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  const std::vector<std::string> words = recognizer.table().words();
  const std::vector<Clip> clips = allClips();
  int right = 0;
  int all = 0;

  for (size_t i = 0; i < clips.size(); i += 8)
  {
    if (std::find(words.begin(), words.end(), clips[i].word) == words.end())
    {
      continue;
    }
    const Samples samples = readAudioFile(clips[i].path);
    const Recognition recognition = recognizer.recognize(samples.data(), samples.size());
    ++all;
    right += recognition.text == clips[i].word ? 1 : 0;
    EXPECT_TRUE(recognition.accepted);
    EXPECT_GE(recognition.confidence, 0.0);
    EXPECT_LE(recognition.confidence, 1.0);
  }

  ASSERT_GT(all, 100);
  EXPECT_GE(right, 0.85 * all) << right << " of " << all;
}

TEST_F(CommandRecognizerTest, SafeModeRejectsWhatIsNoCommand)
{
  CommandRecognizer& recognizer = tenWords(RecognitionMode::SAFE);
  Samples tone = whiteNoise(10.0, 10.0);
  const Samples sines = sine(1000.0, 3000.0, 8.0, SAMPLE_RATE_HZ);
  for (size_t i = 0; i < sines.size(); ++i)
  {
    tone[SAMPLE_RATE_HZ + i] = toSample(tone[SAMPLE_RATE_HZ + i] + sines[i]);
  }
  Samples burst = whiteNoise(10.0, 10.0);
  const Samples loud = whiteNoise(4.0, 2000.0, 5);
  std::copy(loud.begin(), loud.end(), burst.begin() + 3L * SAMPLE_RATE_HZ);
  const std::map<std::string, Samples> sounds{{"white noise", whiteNoise(10.0, 1000.0)},
                                              {"silence", Samples(samplesIn(10.0), 0)},
                                              {"tone", tone},
                                              {"noise that sets in", burst}};
  for (const auto& [name, samples] : sounds)
  {
    for (const Recognition& recognition : recognitionsOf(&recognizer, samples))
    {
      EXPECT_FALSE(recognition.accepted) << name << ": " << recognition.text << ", " << recognition.confidence;
      EXPECT_NE("", recognition.reason) << name;
    }
  }
}

TEST_F(CommandRecognizerTest, SafeModeTakesLongTalkForNoCommand)
{
  CommandRecognizer& recognizer = tenWords(RecognitionMode::SAFE);

  const std::vector<Recognition> recognitions = recognitionsOf(&recognizer, babble(20.0));

  ASSERT_FALSE(recognitions.empty());
  EXPECT_TRUE(contains(recognitions.front().reason, "too long")) << recognitions.front().reason;
  EXPECT_EQ("", recognitions.front().text);
  for (const Recognition& recognition : recognitions)
  {
    EXPECT_FALSE(recognition.accepted) << recognition.text << ", " << recognition.confidence;
  }
}

TEST_F(CommandRecognizerTest, SafeModeTellsCommandsFromOtherWords)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::SAFE);
  const std::vector<Clip> clips = allClips();
  std::map<bool, int> all;
  std::map<bool, int> accepted;

  for (size_t i = 4; i < clips.size(); i += 32)
  {
    const bool is_command = clips[i].word[0] != '_';
    const Samples samples = readAudioFile(clips[i].path);
    const Recognition recognition = recognizer.recognize(samples.data(), samples.size());
    ++all[is_command];
    accepted[is_command] += recognition.accepted ? 1 : 0;
    EXPECT_EQ(recognition.accepted, recognition.reason.empty());
  }

  ASSERT_GT(all[true], 30);
  ASSERT_GT(all[false], 8);
  EXPECT_GE(accepted[true], 0.5 * all[true]) << accepted[true] << " of " << all[true];
  EXPECT_LE(accepted[false], 0.25 * all[false]) << accepted[false] << " of " << all[false];
}

TEST_F(CommandRecognizerTest, StopIsToldFastAndOnce)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  const EndPointerOptions times = optionsOf(RecognitionMode::CLOSED).end_pointer;
  int heard = 0;
  for (const Samples& stream : spoken("stop", 8))
  {
    int fast = 0;
    int stops = 0;
    for (const Recognition& recognition : recognitionsOf(&recognizer, stream))
    {
      stops += recognition.text == "stop" ? 1 : 0;
      if (recognition.fast)
      {
        ++fast;
        EXPECT_EQ("stop", recognition.text);
        EXPECT_LT(recognition.decided_at - recognition.speech_end,
                  static_cast<int64_t>(times.end_silence_s * SAMPLE_RATE_HZ));
      }
    }
    EXPECT_LE(fast, 1);
    EXPECT_TRUE(fast == 0 || stops == 1) << stops;
    heard += fast;
  }
  EXPECT_GE(heard, 5);
}

TEST_F(CommandRecognizerTest, OtherCommandsWaitForTheEndOfTheUtterance)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  const EndPointerOptions times = optionsOf(RecognitionMode::CLOSED).end_pointer;
  int heard = 0;
  for (const Samples& stream : spoken("yes", 4))
  {
    for (const Recognition& recognition : recognitionsOf(&recognizer, stream))
    {
      if (recognition.text == "yes")
      {
        ++heard;
        EXPECT_FALSE(recognition.fast);
        // Frames of 10 ms, chunks of 20 ms.
        EXPECT_GE(recognition.decided_at - recognition.speech_end,
                  static_cast<int64_t>((times.end_silence_s - 0.03) * SAMPLE_RATE_HZ));
      }
    }
  }
  EXPECT_GE(heard, 3);
}

TEST_F(CommandRecognizerTest, UtterancesOfAStreamAreToldInTheirOrder)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  Samples stream = spoken("yes", 1).front();
  const auto boundary = static_cast<int64_t>(stream.size());
  const Samples second = spoken("right", 1).front();
  stream.insert(stream.end(), second.begin(), second.end());

  const std::vector<Recognition> all = recognitionsOf(&recognizer, stream);

  std::vector<Recognition> commands;
  std::copy_if(all.begin(), all.end(), std::back_inserter(commands),
               [](const Recognition& r) { return r.text == "yes" || r.text == "right"; });
  ASSERT_EQ(2U, commands.size());
  EXPECT_EQ("yes", commands[0].text);
  EXPECT_EQ("right", commands[1].text);
  // The room may change with a sound at the boundary.
  EXPECT_LT(commands[0].speech_end, boundary);
  EXPECT_GT(commands[1].speech_begin, boundary - SAMPLE_RATE_HZ / 10);
  for (const Recognition& recognition : all)
  {
    EXPECT_LT(recognition.speech_begin, recognition.speech_end);
    EXPECT_LE(recognition.speech_end, recognition.decided_at);
    EXPECT_LE(recognition.decided_at, static_cast<int64_t>(stream.size()));
    EXPECT_GT(recognition.work_s, 0.0);
  }
}

TEST_F(CommandRecognizerTest, AfterAResetTheSameSoundIsRecognisedAlike)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::SAFE);
  const Samples stream = spoken("right", 1).front();
  const std::vector<Recognition> first = recognitionsOf(&recognizer, stream);
  ASSERT_FALSE(first.empty());
  // Another stream breaks off in the middle of a word.
  Samples other = whiteNoise(1.3, 300.0);
  addTones(&other, 1.0, 1.3, 1000.0);
  recognizer.process(other.data(), other.size(), [](const Recognition&) {});
  ASSERT_TRUE(recognizer.inSpeech());
  recognizer.reset();
  EXPECT_FALSE(recognizer.inSpeech());

  const std::vector<Recognition> second = recognitionsOf(&recognizer, stream);

  ASSERT_EQ(first.size(), second.size());
  for (size_t i = 0; i < first.size(); ++i)
  {
    expectSame(first[i], second[i]);
    EXPECT_EQ(first[i].decided_at, second[i].decided_at);
  }
}

TEST_F(CommandRecognizerTest, TheSizeOfTheChunksDoesNotMatter)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  const Samples stream = spoken("stop", 1).front();
  const std::vector<Recognition> expected = recognitionsOf(&recognizer, stream);
  ASSERT_FALSE(expected.empty());

  const std::vector<Recognition> at_once = recognitionsOf(&recognizer, stream, stream.size());

  ASSERT_EQ(expected.size(), at_once.size());
  for (size_t i = 0; i < expected.size(); ++i)
  {
    expectSame(expected[i], at_once[i]);
  }
}

TEST_F(CommandRecognizerTest, TheRunnersWorkDecides)
{
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  Samples stream = whiteNoise(2.5, 30.0);
  addTones(&stream, 1.0, 1.5, 300.0);
  const std::vector<Recognition> expected = recognitionsOf(&recognizer, stream);
  ASSERT_EQ(1U, expected.size());
  std::vector<double> speech;
  bool is_working = false;
  recognizer.setRunner(
      [&](double speech_s, const std::function<void()>& work)
      {
        speech.push_back(speech_s);
        is_working = true;
        std::thread(work).join();
        is_working = false;
      });
  std::vector<Recognition> told;

  recognizer.reset();
  recognizer.process(stream.data(), stream.size(),
                     [&](const Recognition& recognition)
                     {
                       EXPECT_FALSE(is_working);
                       told.push_back(recognition);
                     });

  ASSERT_EQ(1U, told.size());
  expectSame(expected[0], told[0]);
  ASSERT_FALSE(speech.empty());
  EXPECT_NEAR(0.5, speech.back(), 0.05);
  speech.clear();
  recognizer.recognize(stream.data(), stream.size());
  ASSERT_EQ(1U, speech.size());
  EXPECT_NEAR(2.5, speech[0], 1e-9);
}

TEST_F(CommandRecognizerTest, TheUtteranceSinkGetsEachUtterance)
{
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  Samples stream = whiteNoise(4.0, 30.0);
  addTones(&stream, 1.0, 1.5, 300.0);
  addTones(&stream, 2.5, 3.2, 300.0);
  std::vector<Recognition> told;
  std::vector<std::pair<Utterance, Recognition>> got;
  recognizer.setUtteranceSink(
      [&](const Utterance& utterance, const Recognition& recognition)
      {
        EXPECT_EQ(got.size() + 1, told.size()) << "told before";
        got.emplace_back(utterance, recognition);
      });

  recognizer.process(stream.data(), stream.size(), [&](const Recognition& r) { told.push_back(r); });

  ASSERT_EQ(2U, got.size());
  for (size_t i = 0; i < 2; ++i)
  {
    expectSame(told[i], got[i].second);
    const Utterance& utterance = got[i].first;
    EXPECT_EQ(told[i].speech_begin, utterance.speech_begin);
    EXPECT_TRUE(std::equal(utterance.samples.begin(), utterance.samples.end(), stream.begin() + utterance.begin));
    EXPECT_GE(utterance.begin + static_cast<int64_t>(utterance.samples.size()), utterance.speech_end);
  }
}

TEST_F(CommandRecognizerTest, AnUtteranceIsDecidedWhenTheStreamEnds)
{
  CommandRecognizer& recognizer = tenWords(RecognitionMode::CLOSED);
  Samples stream = whiteNoise(1.5, 30.0);
  addTones(&stream, 1.0, 1.5, 300.0);
  std::vector<Recognition> told;
  const CommandRecognizer::Sink sink = [&](const Recognition& r) { told.push_back(r); };
  recognizer.process(stream.data(), stream.size(), sink);
  ASSERT_TRUE(told.empty());
  ASSERT_TRUE(recognizer.inSpeech());

  recognizer.flush(sink);

  EXPECT_EQ(1U, told.size());
  EXPECT_FALSE(recognizer.inSpeech());
  recognizer.flush(sink);
  EXPECT_EQ(1U, told.size());
}

TEST_F(CommandRecognizerTest, WithoutSoundThereIsNoCommand)
{
  CommandRecognizer& recognizer = tenWords(RecognitionMode::SAFE);
  const Samples silence(SAMPLE_RATE_HZ / 100, 0);

  for (const size_t count : {size_t{0}, size_t{1}, silence.size()})
  {
    const Recognition recognition = recognizer.recognize(silence.data(), count);
    EXPECT_FALSE(recognition.accepted) << count << " samples: " << recognition.text << ", " << recognition.confidence;
    EXPECT_NE("", recognition.reason);
  }
}

TEST_F(CommandRecognizerTest, AWordIsNoLongSpeech)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer& recognizer = tenWords(RecognitionMode::SAFE);
  int accepted = 0;
  for (const Samples& stream : spoken("yes", 8))
  {
    const Samples clip(stream.begin() + SAMPLE_RATE_HZ, stream.end() - SAMPLE_RATE_HZ);
    accepted += recognizer.recognize(clip.data(), clip.size(), 0.7).accepted ? 1 : 0;
    const Recognition recognition = recognizer.recognize(clip.data(), clip.size(), 1.7);
    EXPECT_FALSE(recognition.accepted);
    EXPECT_TRUE(recognition.text.empty() || contains(recognition.reason, "too long for it: 1.70 s of speech, 1.60 s"))
        << recognition.reason;
  }
  EXPECT_GE(accepted, 5);
}

TEST_F(CommandRecognizerTest, ASureCommandIsToldEarlyUnlessAnotherBeginsWithIt)
{
  SKIP_WITHOUT_CLIPS();
  RecognizerOptions options = optionsOf(RecognitionMode::CLOSED);
  options.sure_confidence = 0.6;
  const auto early = [&options](const std::string& commands)
  {
    CommandRecognizer recognizer(options, table(commands));
    int count = 0;
    for (const Samples& stream : spoken("yes", 8))
    {
      for (const Recognition& recognition : recognitionsOf(&recognizer, stream))
      {
        EXPECT_TRUE(!recognition.fast || recognition.confidence >= options.sure_confidence);
        count += recognition.fast && recognition.text == "yes" ? 1 : 0;
      }
    }
    return count;
  };

  EXPECT_GE(early("'yes', stop, left"), 3);
  EXPECT_EQ(0, early("'yes', yes left, stop"));
}

TEST_F(CommandRecognizerTest, PhrasesAreUnderstood)
{
  if (!fs::exists(GO_FORWARD))
  {
    GTEST_SKIP() << "no " << GO_FORWARD << "; install pocketsphinx-testdata";
  }
  CommandRecognizer recognizer(optionsOf(RecognitionMode::CLOSED),
                               table("go forward ten meters, go back, turn left, stop"));
  const Samples samples = readAudioFile(GO_FORWARD);

  const Recognition recognition = recognizer.recognize(samples.data(), samples.size());

  EXPECT_EQ("go forward ten meters", recognition.text);
  EXPECT_TRUE(recognition.accepted);
  EXPECT_EQ(4, recognition.evidence.words);
  EXPECT_GT(recognition.evidence.word_margin, 3.0);
  EXPECT_GT(recognition.evidence.word_score, -5.0);
  EXPECT_EQ(static_cast<int64_t>(samples.size()), recognition.speech_end);
}

TEST_F(CommandRecognizerTest, TheThresholdOfTheNetworkIsNotThatOfPocketSphinx)
{
  if (!fs::exists(GO_FORWARD))
  {
    GTEST_SKIP() << "no " << GO_FORWARD << "; install pocketsphinx-testdata";
  }
  const Samples samples = readAudioFile(GO_FORWARD);
  RecognizerOptions options = optionsOf(RecognitionMode::SAFE);
  options.threshold = 0.001;
  for (const bool own : {false, true})
  {
    const std::string key = own ? "threshold" : "network_threshold";
    CommandRecognizer recognizer(options, table("go back, {text: go forward ten meters, " + key + ": 1.0}"));
    EXPECT_EQ(!own, recognizer.recognize(samples.data(), samples.size()).accepted) << key;
  }
}

TEST_F(CommandRecognizerTest, PhrasesOfClipsAreUnderstood)
{
  SKIP_WITHOUT_CLIPS();
  CommandRecognizer recognizer(optionsOf(RecognitionMode::CLOSED), table("go left, go right, stop, up"));
  const std::vector<Samples> verbs = spoken("go", 4);
  int right = 0;
  int all = 0;
  for (const std::string side : {"left", "right"})
  {
    const std::vector<Samples> sides = spoken(side, verbs.size());
    for (size_t i = 0; i < verbs.size(); ++i)
    {
      // The clips alone, without the rooms around them.
      Samples phrase(verbs[i].begin() + SAMPLE_RATE_HZ, verbs[i].end() - SAMPLE_RATE_HZ);
      phrase.insert(phrase.end(), sides[i].begin() + SAMPLE_RATE_HZ, sides[i].end() - SAMPLE_RATE_HZ);
      const Recognition recognition = recognizer.recognize(phrase.data(), phrase.size());
      ++all;
      right += recognition.text == "go " + side ? 1 : 0;
    }
  }
  EXPECT_GE(right, 0.7 * all) << right << " of " << all;
}

TEST_F(CommandRecognizerTest, AFileThatIsWrongIsNamed)
{
  const TemporaryFolder folder;
  const std::string bad = folder.file("bad", "<not> a file: [of any kind\n");
  const std::string missing = folder.path() + "/missing";
  EXPECT_EQ("", errorOf(optionsOf(RecognitionMode::SAFE)));
  for (const std::string& path : {bad, missing, folder.path()})
  {
    for (std::string RecognizerOptions::*file : {&RecognizerOptions::garbage_words, &RecognizerOptions::confidence})
    {
      RecognizerOptions options = optionsOf(RecognitionMode::SAFE);
      options.*file = path;
      EXPECT_TRUE(contains(errorOf(options), path)) << path << ": " << errorOf(options);
    }
  }
}

TEST_F(CommandRecognizerTest, ATableWithoutCommandsIsAnError)
{
  EXPECT_THROW(CommandRecognizer(optionsOf(RecognitionMode::CLOSED), CommandTable()), std::invalid_argument);
}

}  // namespace
}  // namespace pi_speech
