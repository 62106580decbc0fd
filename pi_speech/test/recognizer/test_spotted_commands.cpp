#include <gtest/gtest.h>
#include <pi_speech/command_recognizer.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "audio/synthetic_sounds.h"
#include "network/tone_words.h"

#include "recognizer/test_support.h"

namespace pi_speech
{
namespace
{

using Texts = std::vector<std::string>;

RecognizerOptions networkOptions(RecognitionMode mode = RecognitionMode::SAFE)
{
  RecognizerOptions options;
  options.mode = mode;
  options.word_network = toneNetwork();
  options.all_in_running_speech = true;
  options.garbage_words = std::string(PI_SPEECH_CONFIG) + "/garbage_words.txt";
  options.confidence = std::string(PI_SPEECH_CONFIG) + "/confidence.yaml";
  options.sphinx.check_model = false;
  return options;
}

/// Its commands are all known to the network, so PocketSphinx has nothing to do and need not be there.
class SpottedCommands : public testing::Test
{
protected:
  explicit SpottedCommands(RecognitionMode mode = RecognitionMode::SAFE)
  {
    RecognizerOptions options = networkOptions(mode);
    options.sphinx.acoustic_model = "/no/such/model";
    recognizer_ = std::make_unique<CommandRecognizer>(options, table("go, left, {text: stop, fast: true}"));
    recognizer_->setUtteranceSink([this](const Utterance& utterance, const Recognition& recognition)
                                  { utterances_.emplace_back(utterance, recognition); });
  }

  void hear(const Samples& samples) { recognizer_->process(samples.data(), samples.size(), sink_); }

  Texts accepted() const
  {
    Texts texts;
    for (const Recognition& recognition : told_)
    {
      if (recognition.accepted)
      {
        texts.push_back(recognition.text);
      }
    }
    return texts;
  }

  std::unique_ptr<CommandRecognizer> recognizer_;
  std::vector<Recognition> told_;
  std::vector<std::pair<Utterance, Recognition>> utterances_;
  const CommandRecognizer::Sink sink_ = [this](const Recognition& recognition) { told_.push_back(recognition); };
};

class ClosedSpottedCommands : public SpottedCommands
{
protected:
  ClosedSpottedCommands() : SpottedCommands(RecognitionMode::CLOSED) {}
};

/// Words in a row, with pauses too short to end an utterance.
Samples sentence()
{
  Samples samples = whiteNoise(4.0, 30.0);
  const Texts words = {"right", "left", "right", "stop", "right", "left"};
  for (size_t i = 0; i < words.size(); ++i)
  {
    say(&samples, words[i], 1.0 + 0.4 * static_cast<double>(i));
  }
  return samples;
}

TEST_F(SpottedCommands, AreHeardInsideASentence)
{
  hear(sentence());

  EXPECT_EQ((Texts{"left", "stop", "left"}), accepted());
  for (const Recognition& recognition : told_)
  {
    EXPECT_TRUE(recognition.fast);
    EXPECT_GT(recognition.confidence, 0.5);
    EXPECT_GT(recognition.decided_at, recognition.speech_end);
    EXPECT_LT(recognition.decided_at, recognition.speech_end + SAMPLE_RATE_HZ / 4);
  }
  ASSERT_EQ(1U, utterances_.size());
  EXPECT_EQ("left", utterances_[0].second.text);
  EXPECT_TRUE(utterances_[0].second.accepted);
}

TEST_F(SpottedCommands, AreNamed)
{
  EXPECT_EQ((Texts{"go", "left", "stop"}), recognizer_->spottedCommands());
}

TEST_F(SpottedCommands, SpeechWithoutOneIsRejected)
{
  Samples samples = whiteNoise(3.0, 30.0);
  say(&samples, "right", 1.0);

  hear(samples);

  ASSERT_EQ(1U, told_.size());
  EXPECT_FALSE(told_[0].accepted);
  EXPECT_TRUE(told_[0].reason.rfind("confidence ", 0) == 0) << told_[0].reason;
  ASSERT_EQ(1U, utterances_.size());
  EXPECT_FALSE(utterances_[0].second.accepted);
}

TEST_F(SpottedCommands, TheSizeOfTheChunksDoesNotMatter)
{
  const Samples samples = sentence();
  hear(samples);
  const std::vector<Recognition> at_once = std::exchange(told_, {});
  recognizer_->reset();

  for (size_t i = 0; i < samples.size(); i += 100)
  {
    hear(Samples(samples.begin() + i, samples.begin() + std::min(samples.size(), i + 100)));
  }

  ASSERT_EQ(at_once.size(), told_.size());
  for (size_t i = 0; i < told_.size(); ++i)
  {
    EXPECT_EQ(at_once[i].text, told_[i].text);
    EXPECT_EQ(at_once[i].speech_end, told_[i].speech_end);
    EXPECT_EQ(at_once[i].confidence, told_[i].confidence);
  }
}

TEST_F(SpottedCommands, AWordIsToldWhenTheStreamEnds)
{
  Samples samples = whiteNoise(2.0, 30.0);
  say(&samples, "left", 1.0);
  samples.resize(samplesIn(1.12));
  hear(samples);
  ASSERT_TRUE(told_.empty());

  recognizer_->flush(sink_);

  EXPECT_EQ(Texts{"left"}, accepted());
  recognizer_->flush(sink_);
  EXPECT_EQ(1U, told_.size());
}

TEST_F(SpottedCommands, OfASinglePieceOfSoundAreJudged)
{
  Samples samples = whiteNoise(0.6, 30.0);
  say(&samples, "left", 0.2);
  const Recognition left = recognizer_->recognize(samples.data(), samples.size(), 0.3);
  EXPECT_EQ("left", left.text);
  EXPECT_TRUE(left.accepted) << left.reason;

  const Samples nothing(samples.size(), 0);  // the network of tones takes noise that begins for one
  const Recognition none = recognizer_->recognize(nothing.data(), nothing.size(), 0.3);
  EXPECT_FALSE(none.accepted);
  EXPECT_NE("", none.reason);
  EXPECT_FALSE(recognizer_->recognize(nothing.data(), 0, 0.0).accepted);
}

TEST(SpottedCommandsThatShip, APieceOfNoiseIsNone)
{
  RecognizerOptions options = networkOptions();
  options.word_network = std::string(PI_SPEECH_CONFIG) + "/word_network.bin";
  options.sphinx.acoustic_model = "/no/such/model";
  CommandRecognizer recognizer(options, CommandTable::load(std::string(PI_SPEECH_CONFIG) + "/commands.yaml"));
  for (const double deviation : {1.0, 30.0, 1000.0, 10000.0})
  {
    for (uint32_t seed = 1; seed <= 10; ++seed)
    {
      const Samples noise = whiteNoise(0.3 + 0.1 * seed, deviation, seed);
      const Recognition none = recognizer.recognize(noise.data(), noise.size(), 0.0);
      EXPECT_FALSE(none.accepted) << none.text << " " << none.confidence << " in noise of " << deviation;
      EXPECT_NE("", none.reason);
    }
  }
}

TEST_F(ClosedSpottedCommands, TheBestIsTakenHoweverFaint)
{
  Samples samples = whiteNoise(3.0, 30.0);
  say(&samples, "right", 1.0);

  hear(samples);

  ASSERT_EQ(1U, accepted().size());
  EXPECT_LT(told_[0].confidence, 0.5);
}

TEST_F(SpottedCommands, WaitForOtherComputersExceptFastOnes)
{
  int asked = 0;
  std::optional<Recognition> answer;
  recognizer_->setElsewhere(
      [&](const Utterance&)
      {
        ++asked;
        return answer;
      });
  Samples samples = whiteNoise(3.0, 30.0);
  say(&samples, "left", 1.0);

  answer.emplace();
  answer->text = "go";
  answer->accepted = true;
  answer->place = "edge";
  hear(samples);
  EXPECT_EQ(Texts{"go"}, accepted());
  EXPECT_EQ("edge", told_[0].place);
  EXPECT_GT(asked, 0);

  answer.reset();
  told_.clear();
  hear(samples);
  EXPECT_EQ(Texts{"left"}, accepted());

  told_.clear();
  Samples stop = whiteNoise(1.2, 30.0);
  say(&stop, "stop", 0.9);
  hear(stop);
  EXPECT_EQ(Texts{"stop"}, accepted());
}

TEST(SpottedCommandsInDoubt, AreToldOnceAndNotAccepted)
{
  CommandRecognizer recognizer(networkOptions(), table("go, {text: stop, fast: true, threshold: 1.0, doubt: 0.3}"));
  std::vector<Recognition> told;
  Samples samples = whiteNoise(3.0, 30.0);
  say(&samples, "stop", 1.0);

  recognizer.process(samples.data(), samples.size(),
                     [&](const Recognition& recognition) { told.push_back(recognition); });

  ASSERT_EQ(2U, told.size());  // in the stream, and at the end of the utterance
  EXPECT_EQ("stop", told[0].text);
  EXPECT_TRUE(told[0].doubtful);
  EXPECT_TRUE(told[0].fast);
  EXPECT_FALSE(told[0].accepted);
  EXPECT_EQ(0U, told[0].reason.find("confidence ")) << told[0].reason;
  EXPECT_FALSE(told[1].doubtful);
  EXPECT_FALSE(told[1].accepted);
}

TEST(SpottedCommandsInDoubt, AreJudgedByTheThresholdOfTheNetwork)
{
  Samples samples = whiteNoise(3.0, 30.0);
  say(&samples, "stop", 1.0);
  for (const bool reached : {true, false})
  {
    const std::string thresholds = reached ? "threshold: 1.0, network_threshold: 0.3" : "network_threshold: 1.0";
    CommandRecognizer recognizer(networkOptions(), table("go, {text: stop, fast: true, " + thresholds + "}"));
    size_t accepted = 0;

    recognizer.process(samples.data(), samples.size(),
                       [&](const Recognition& recognition) { accepted += recognition.accepted ? 1 : 0; });

    EXPECT_EQ(reached ? 1U : 0U, accepted) << thresholds;
  }
}

TEST(SpottedCommandsByDefault, AreThoseThatAreFast)
{
  RecognizerOptions options = networkOptions();
  options.all_in_running_speech = false;
  options.sure_confidence = 1.0;  // none is told at a pause that does not end the utterance
  CommandRecognizer recognizer(options, table("go, left, {text: stop, fast: true}"));
  EXPECT_EQ(Texts{"stop"}, recognizer.spottedCommands());
  std::vector<Recognition> told;
  const CommandRecognizer::Sink sink = [&](const Recognition& recognition)
  {
    if (recognition.accepted)
    {
      told.push_back(recognition);
    }
  };
  const Samples talk = sentence();
  recognizer.process(talk.data(), talk.size(), sink);
  ASSERT_EQ(1U, told.size());
  EXPECT_EQ("stop", told[0].text);

  // Alone, with a pause behind it, the other is heard, too.
  Samples alone = whiteNoise(2.0, 30.0);
  say(&alone, "left", 1.0);
  told.clear();
  recognizer.process(alone.data(), alone.size(), sink);
  ASSERT_EQ(1U, told.size());
  EXPECT_EQ("left", told[0].text);
  EXPECT_GT(told[0].confidence, 0.5);
}

TEST(SpottedCommandsBesidePhrases, AreThoseThatNoPhraseContains)
{
  if (!std::filesystem::exists(SphinxModel().acoustic_model))
  {
    GTEST_SKIP() << "no " << SphinxModel().acoustic_model << "; install pocketsphinx-en-us";
  }
  const CommandRecognizer recognizer(networkOptions(), table("go left, left, right, {text: stop, fast: true}, halt"));

  EXPECT_EQ((Texts{"right", "stop"}), recognizer.spottedCommands());
}

TEST(SpottedCommandsFile, ThatIsMissingIsNamed)
{
  RecognizerOptions options = networkOptions();
  options.word_network = "/no/such/network.bin";
  try
  {
    CommandRecognizer recognizer(options, table("go"));
    FAIL() << "loaded";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_EQ(0U, std::string(error.what()).find("/no/such/network.bin: ")) << error.what();
  }
}

}  // namespace
}  // namespace pi_speech
