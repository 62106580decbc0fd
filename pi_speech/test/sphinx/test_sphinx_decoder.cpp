#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/sphinx_decoder.h>
#include "recognizer/grammar.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <memory>
#include <numeric>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

namespace fs = std::filesystem;

const std::string TEST_DATA = "/usr/share/pocketsphinx/test/data";
const std::vector<std::string> GO_FORWARD = {"go", "forward", "ten", "meters", "stop", "left"};
constexpr char GO_FORWARD_GRAMMAR[] = "#JSGF V1.0; grammar g; public <g> = go forward ten meters | go left | stop;";

#define SKIP_WITHOUT(path, package)                               \
  if (!fs::exists(path))                                          \
  {                                                               \
    GTEST_SKIP() << "no " << (path) << "; install " << (package); \
  }

/// The ten commands of the package, without a check of the model; then each alone.
std::unique_ptr<SphinxDecoder> tenCommands()
{
  const std::vector<std::string> words = CommandTable::load(std::string(PI_SPEECH_CONFIG) + "/commands.yaml").words();
  SphinxModel model;
  model.check_model = false;
  std::vector<std::string> grammars = {toJsgf(words)};
  for (const std::string& word : words)
  {
    grammars.push_back(toJsgf({word}));
  }
  return std::make_unique<SphinxDecoder>(model, grammars, words);
}

Samples noise(size_t count, int loudness)
{
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0.0, loudness);
  Samples samples(count);
  for (int16_t& sample : samples)
  {
    sample = static_cast<int16_t>(std::clamp(normal(random), -32000.0, 32000.0));
  }
  return samples;
}

bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

std::string errorOf(const SphinxModel& model, const std::string& jsgf = GO_FORWARD_GRAMMAR,
                    const std::vector<std::string>& words = GO_FORWARD)
{
  try
  {
    SphinxDecoder decoder(model, jsgf.empty() ? std::vector<std::string>() : std::vector<std::string>{jsgf}, words);
    return "";
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
}

class SphinxDecoderTest : public testing::Test
{
protected:
  void SetUp() override { SKIP_WITHOUT(SphinxModel().acoustic_model, "pocketsphinx-en-us"); }
};

TEST_F(SphinxDecoderTest, UnderstandsASentenceOfItsGrammar)
{
  SKIP_WITHOUT(TEST_DATA + "/goforward.raw", "pocketsphinx-testdata");
  SphinxDecoder decoder(SphinxModel(), {GO_FORWARD_GRAMMAR}, GO_FORWARD);
  const Samples samples = readAudioFile(TEST_DATA + "/goforward.raw");

  const SphinxHypothesis hypothesis = decoder.decode(samples);

  EXPECT_EQ("go forward ten meters", hypothesis.text());
  ASSERT_EQ(4U, hypothesis.words.size());
  // One frame per 10 ms of sound, up to those of the last window.
  EXPECT_NEAR(static_cast<double>(samples.size()) / 160.0, hypothesis.frames, 3.0);
  int end = 0;
  for (const SphinxHypothesis::Word& word : hypothesis.words)
  {
    EXPECT_GE(word.first_frame, end);
    EXPECT_GT(word.last_frame, word.first_frame);
    EXPECT_LT(word.score, 0);
    end = word.last_frame;
  }
  EXPECT_LT(end, hypothesis.frames);
  // Its words are within the speech, which PocketSphinx' own decoder puts at 0.46 to 2.12 s.
  EXPECT_NEAR(46, hypothesis.words.front().first_frame, 10);
  EXPECT_NEAR(212, hypothesis.words.back().last_frame, 10);
}

TEST_F(SphinxDecoderTest, TheSameSoundHasTheSameResultWhateverWasBefore)
{
  SKIP_WITHOUT(TEST_DATA + "/goforward.raw", "pocketsphinx-testdata");
  SphinxModel model;
  model.check_model = false;
  SphinxDecoder decoder(model, {GO_FORWARD_GRAMMAR, "#JSGF V1.0; grammar g; public <g> = stop left ten go;"},
                        GO_FORWARD);
  const Samples samples = readAudioFile(TEST_DATA + "/goforward.raw");
  const SphinxHypothesis first = decoder.decode(samples);
  const double first_phones = decoder.findPhones().score;

  decoder.decode(noise(32000, 8000));
  EXPECT_NE(first_phones, decoder.findPhones().score);
  const SphinxHypothesis second = decoder.decode(samples);

  EXPECT_EQ(first.text(), second.text());
  EXPECT_EQ(first.score, second.score);
  EXPECT_EQ(first.words.back().last_frame, second.words.back().last_frame);
  EXPECT_EQ(first_phones, decoder.findPhones().score);
  EXPECT_EQ(first.score, decoder.find(0).score) << "a search changes nothing";
}

TEST_F(SphinxDecoderTest, ScoresOfGrammarsCanBeCompared)
{
  SKIP_WITHOUT(TEST_DATA + "/goforward.raw", "pocketsphinx-testdata");
  SphinxModel model;
  model.check_model = false;
  SphinxDecoder decoder(model, {GO_FORWARD_GRAMMAR, "#JSGF V1.0; grammar g; public <g> = stop left ten go;"},
                        GO_FORWARD);
  const Samples samples = readAudioFile(TEST_DATA + "/goforward.raw");
  decoder.listen(samples.data(), samples.size());

  const SphinxHypothesis right = decoder.find(0);
  const SphinxHypothesis wrong = decoder.find(1);
  const SphinxHypothesis phones = decoder.findPhones();

  EXPECT_EQ("go forward ten meters", right.text());
  EXPECT_LT(right.score, 0.0);
  EXPECT_GT(right.score, wrong.score + 0.2 * right.frames);
  EXPECT_GT(phones.score, wrong.score);
  EXPECT_GT(phones.words.size(), 10U);
  EXPECT_EQ(right.frames, phones.frames);
  EXPECT_THROW(decoder.find(2), std::out_of_range);
}

TEST_F(SphinxDecoderTest, TheBestCommandIsTheBestOfEach)
{
  SKIP_WITHOUT(TEST_DATA + "/goforward.raw", "pocketsphinx-testdata");
  const std::unique_ptr<SphinxDecoder> decoder = tenCommands();
  const Samples samples = readAudioFile(TEST_DATA + "/goforward.raw");
  const Samples go(samples.begin() + 5600, samples.begin() + 12000);
  decoder->listen(go.data(), go.size());

  const SphinxHypothesis best = decoder->find(0);
  double most = -std::numeric_limits<double>::infinity();
  for (size_t i = 1; i <= 10; ++i)
  {
    most = std::max(most, decoder->find(i).score);
  }

  EXPECT_EQ(1U, best.words.size());
  EXPECT_NEAR(most, best.score, 0.02 * std::abs(most));
}

TEST_F(SphinxDecoderTest, TakesAnySound)
{
  const std::unique_ptr<SphinxDecoder> decoder = tenCommands();

  EXPECT_TRUE(decoder->decode(Samples()).words.empty());
  EXPECT_TRUE(decoder->decode(Samples(1919, 100)).words.empty());
  EXPECT_TRUE(decoder->findPhones().words.empty());
  for (const Samples& samples : {Samples(1920, 0), Samples(16000, 0), Samples(16000, 32767), Samples(16000, -32768),
                                 noise(16000, 3000), noise(1921, 20000), noise(480000, 3000)})
  {
    const SphinxHypothesis hypothesis = decoder->decode(samples);
    EXPECT_NEAR(static_cast<double>(samples.size()) / 160.0, hypothesis.frames, 3.0);
    EXPECT_TRUE(std::isfinite(hypothesis.score));
    EXPECT_TRUE(std::isfinite(decoder->findPhones().score));
    EXPECT_LE(hypothesis.words.size(), 1U);
  }
}

TEST_F(SphinxDecoderTest, AnUtteranceOfMoreThanFiveMinutesIsRefused)
{
  const std::unique_ptr<SphinxDecoder> decoder = tenCommands();
  const Samples samples(301 * SAMPLE_RATE_HZ);

  EXPECT_THROW(decoder->decode(samples), std::invalid_argument);
  EXPECT_THROW(decoder->listen(samples.data(), samples.size()), std::invalid_argument);
  EXPECT_TRUE(decoder->find(0).words.empty()) << "what was heard before it does not count";
}

TEST_F(SphinxDecoderTest, TakesWordsWithHyphensApostrophesAndDigits)
{
  SphinxModel model;
  model.check_model = false;
  EXPECT_EQ("", errorOf(model, toJsgf({"x-ray", "don't stop", "go 5", "zorble", "o'clock"}),
                        {"x-ray", "don't", "stop", "go", "5", "zorble", "o'clock"}));
}

TEST_F(SphinxDecoderTest, AWordOfTheGrammarThatIsNotGivenIsNamed)
{
  SphinxModel model;
  model.check_model = false;
  const std::string error = errorOf(model, "#JSGF V1.0; grammar g; public <g> = go | halt;", {"go"});

  EXPECT_TRUE(contains(error, "halt")) << error;
}

TEST_F(SphinxDecoderTest, AGrammarThatIsNoneIsAnError)
{
  SphinxModel model;
  model.check_model = false;

  EXPECT_TRUE(contains(errorOf(model, "go or stop", {"go", "stop"}), "does not begin with \"#JSGF V1.0;\""));
  EXPECT_TRUE(
      contains(errorOf(model, "#JSGF V1.0; grammar g; public <g> = (go;", {"go"}), "the grammar cannot be used"));
  EXPECT_TRUE(contains(errorOf(model, "#JSGF V1.0; grammar g; <g> = go;", {"go"}), "the grammar cannot be used"));
}

TEST_F(SphinxDecoderTest, AWordThatCannotBePronouncedIsNamed)
{
  SphinxModel model;
  model.guess_words = false;
  const std::string error = errorOf(model, "#JSGF V1.0; grammar g; public <g> = zorble;", {"zorble"});

  EXPECT_TRUE(contains(error, "\"zorble\" is not in the dictionary")) << error;
}

TEST_F(SphinxDecoderTest, MissingPartsAreNamedWithAWayOut)
{
  SphinxModel model;
  model.acoustic_model = "/nowhere/model";
  EXPECT_TRUE(contains(errorOf(model), "/nowhere/model: there is no such folder")) << errorOf(model);
  EXPECT_TRUE(contains(errorOf(model), "install pocketsphinx-en-us")) << errorOf(model);

  model = SphinxModel();
  model.dictionary = "/nowhere/words.dict";
  EXPECT_TRUE(contains(errorOf(model), "/nowhere/words.dict: ")) << errorOf(model);

  model = SphinxModel();
  model.language_model = "/nowhere/words.lm";
  EXPECT_TRUE(contains(errorOf(model, ""), "/nowhere/words.lm: the language model is missing")) << errorOf(model, "");
  EXPECT_EQ("", errorOf(model)) << "a grammar needs no language model";
}

TEST_F(SphinxDecoderTest, UnderstandsDictation)
{
  SKIP_WITHOUT(TEST_DATA + "/goforward.raw", "pocketsphinx-testdata");
  SphinxDecoder decoder(SphinxModel(), {}, {});

  EXPECT_EQ("go forward ten meters", decoder.decode(readAudioFile(TEST_DATA + "/goforward.raw")).text());
}

/// Words to add, remove or replace to make one of the other.
size_t distance(const std::vector<std::string>& from, const std::vector<std::string>& to)
{
  std::vector<size_t> row(to.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (size_t i = 1; i <= from.size(); ++i)
  {
    size_t diagonal = std::exchange(row[0], i);
    for (size_t j = 1; j <= to.size(); ++j)
    {
      const size_t replaced = diagonal + (from[i - 1] == to[j - 1] ? 0 : 1);
      diagonal = std::exchange(row[j], std::min({replaced, row[j] + 1, row[j - 1] + 1}));
    }
  }
  return row.back();
}

std::vector<std::string> wordsOf(const std::string& text)
{
  std::istringstream stream(text);
  return {std::istream_iterator<std::string>(stream), std::istream_iterator<std::string>()};
}

/// Its error rate is in docs/benchmarks/speech.md.
TEST_F(SphinxDecoderTest, WritesReadSentencesDownWithFewerThanHalfOfTheWordsWrong)
{
  const std::string folder = TEST_DATA + "/librivox/";
  SKIP_WITHOUT(folder + "transcription", "pocketsphinx-testdata");
  SphinxModel model;
  model.adaptation = std::string(PI_SPEECH_CONFIG) + "/adaptation";
  SphinxDecoder decoder(model, {}, {});
  std::ifstream transcription(folder + "transcription");
  size_t words = 0;
  size_t wrong = 0;
  for (std::string line; std::getline(transcription, line);)
  {
    std::vector<std::string> said = wordsOf(line);  // <s> WORDS </s> (NAME)
    ASSERT_GT(said.size(), 3U) << line;
    const std::string name = said.back().substr(1, said.back().size() - 2);
    said = std::vector<std::string>(said.begin() + 1, said.end() - 2);
    const std::string text = decoder.decode(readAudioFile(folder + name + ".wav")).text();
    words += said.size();
    wrong += distance(said, wordsOf(text));
    std::cout << name << ": " << text << '\n';
  }
  std::cout << wrong << " of " << words << " words wrong\n";
  EXPECT_EQ(71U, words);
  EXPECT_LT(wrong, words / 2);
}

/// A copy of the model with one part damaged; which one and how are in the loops of the tests.
class DamagedModel : public SphinxDecoderTest
{
protected:
  void SetUp() override
  {
    SphinxDecoderTest::SetUp();
    if (IsSkipped())
    {
      return;
    }
    fs::copy(SphinxModel().acoustic_model, folder_.path() + "/model", fs::copy_options::recursive);
    model_.acoustic_model = folder_.path() + "/model";
  }

  std::string part(const std::string& name) const { return model_.acoustic_model + "/" + name; }

  std::string read(const std::string& name) const
  {
    std::ifstream file(part(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }

  std::string errorWith(const std::string& name, const std::string& content) const
  {
    const std::string whole = read(name);
    std::ofstream(part(name), std::ios::binary) << content;
    const std::string error = errorOf(model_);
    std::ofstream(part(name), std::ios::binary) << whole;
    return error;
  }

  TemporaryFolder folder_;
  SphinxModel model_;
};

const std::vector<std::string> PARTS = {"mdef", "means", "variances", "transition_matrices", "sendump", "feat.params"};

TEST_F(DamagedModel, AGoodOneLoads)
{
  EXPECT_EQ("", errorOf(model_));
}

TEST_F(DamagedModel, AMissingPartIsNamed)
{
  for (const std::string& name : PARTS)
  {
    fs::rename(part(name), part("away"));
    EXPECT_EQ(0U, errorOf(model_).find(part(name) + ": this part of the acoustic model is missing")) << errorOf(model_);
    fs::rename(part("away"), part(name));
  }
}

TEST_F(DamagedModel, AnEmptyPartIsNamed)
{
  for (const std::string& name : PARTS)
  {
    const std::string error = errorWith(name, "");
    EXPECT_EQ(0U, error.find(part(name) + ": this part of the acoustic model is empty")) << error;
  }
}

TEST_F(DamagedModel, ATruncatedPartIsAnErrorAndNoDeadProcess)
{
  for (const std::string& name : PARTS)
  {
    const std::string error = errorWith(name, read(name).substr(0, read(name).size() / 2));
    EXPECT_EQ(0U, error.find(model_.acoustic_model)) << name << ": " << error;
    EXPECT_TRUE(contains(error, "install ")) << name << ": " << error;
  }
}

TEST_F(DamagedModel, APartOfRandomBytesIsAnErrorAndNoDeadProcess)
{
  std::mt19937 random(7);
  for (const std::string& name : PARTS)
  {
    std::string bytes = read(name);
    std::generate(bytes.begin(), bytes.end(), [&random] { return static_cast<char>(random()); });
    const std::string error = errorWith(name, bytes);
    EXPECT_EQ(0U, error.find(model_.acoustic_model)) << name << ": " << error;
    EXPECT_TRUE(contains(error, "install ")) << name << ": " << error;
  }
}

TEST_F(DamagedModel, AModelForAnotherRateIsRefused)
{
  const std::string error = errorWith("feat.params", read("feat.params") + "-samprate 8000\n-upperf 3500\n");

  EXPECT_TRUE(contains(error, "is for 8000 Hz")) << error;
}

TEST(SphinxModels, AContinuousModelLoads)
{
  SKIP_WITHOUT(TEST_DATA + "/an4_ci_cont", "pocketsphinx-testdata");
  SKIP_WITHOUT(SphinxModel().dictionary, "pocketsphinx-en-us");
  SphinxModel model;
  model.acoustic_model = TEST_DATA + "/an4_ci_cont";
  SphinxDecoder decoder(model, {GO_FORWARD_GRAMMAR, "#JSGF V1.0; grammar g; public <g> = stop left ten go;"},
                        GO_FORWARD);

  EXPECT_EQ("go forward ten meters", decoder.decode(readAudioFile(TEST_DATA + "/goforward.raw")).text());
}

TEST(SphinxModels, ASemiContinuousModelLoads)
{
  SKIP_WITHOUT(TEST_DATA + "/tidigits/hmm", "pocketsphinx-testdata");
  SphinxModel model;
  model.acoustic_model = TEST_DATA + "/tidigits/hmm";
  model.dictionary = TEST_DATA + "/tidigits/lm/tidigits.dic";
  const std::vector<std::string> words = {"one",   "two",   "three", "four", "five", "six",
                                          "seven", "eight", "nine",  "zero", "oh"};
  std::string digits;
  for (const std::string& word : words)
  {
    digits += (digits.empty() ? "" : " | ") + word;
  }
  SphinxDecoder decoder(model, {"#JSGF V1.0; grammar g; public <g> = (" + digits + ")+;"}, words);

  // A speaker of the corpus says 2934z.
  EXPECT_EQ("two nine three four zero", decoder.decode(readAudioFile(TEST_DATA + "/tidigits/dhd.2934z.raw")).text());
}

TEST(SphinxModels, WordsOfOtherPhonesAreNamed)
{
  SKIP_WITHOUT(TEST_DATA + "/tidigits/hmm", "pocketsphinx-testdata");
  SKIP_WITHOUT(SphinxModel().dictionary, "pocketsphinx-en-us");
  SphinxModel model;
  model.acoustic_model = TEST_DATA + "/tidigits/hmm";
  const std::string error = errorOf(model, "#JSGF V1.0; grammar g; public <g> = stop;", {"stop"});

  EXPECT_TRUE(contains(error, "word 'stop' ignored")) << error;
}

struct Clip
{
  std::string path;
  std::string word;
};

/// Every n-th clip of the commands, so that all words and many speakers are among them.
std::vector<Clip> everyNthClip(const std::string& folder, size_t n)
{
  std::vector<Clip> clips;
  std::ifstream list(folder + "/commands.tsv");
  std::string line;
  std::getline(list, line);
  size_t count = 0;
  while (std::getline(list, line))
  {
    Clip clip;
    std::istringstream fields(line);
    std::getline(fields, clip.path, '\t');
    std::getline(fields, clip.word, '\t');
    clip.path = folder + "/" + clip.path;
    if (clip.word[0] != '_' && count++ % n == 0)
    {
      clips.push_back(clip);
    }
  }
  return clips;
}

TEST_F(SphinxDecoderTest, UnderstandsMostSpokenCommands)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  if (data == nullptr || !fs::exists(std::string(data) + "/speech/commands.tsv"))
  {
    GTEST_SKIP() << "PI_EDGE_DATA names no folder with speech/commands.tsv";
  }
  const std::vector<Clip> clips = everyNthClip(std::string(data) + "/speech", 11);
  ASSERT_GE(clips.size(), 100U);
  const std::unique_ptr<SphinxDecoder> decoder = tenCommands();

  size_t right = 0;
  for (const Clip& clip : clips)
  {
    right += decoder->decode(readAudioFile(clip.path)).text() == clip.word ? 1 : 0;
  }

  // 86 % of all clips; the deviation of 137 of them is 3 %.
  EXPECT_GE(static_cast<double>(right) / static_cast<double>(clips.size()), 0.78);
}

}  // namespace
}  // namespace pi_speech
