#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "network/tone_words.h"
#include "network/word_spotter.h"

namespace pi_speech
{
namespace
{

const std::vector<SpottedWord> LEFT_AND_STOP = {{"left", 0.5, false}, {"stop", 0.3, true}};

struct SpottedAt
{
  WordSpotter::Spotted spotted;
  int64_t at;  ///< samples that had come
};

std::vector<SpottedAt> listen(WordSpotter* spotter, const Samples& samples, size_t chunk = 100)
{
  std::vector<SpottedAt> heard;
  int64_t at = 0;
  for (size_t begin = 0; begin < samples.size(); begin += chunk)
  {
    const size_t count = std::min(chunk, samples.size() - begin);
    at += static_cast<int64_t>(count);
    spotter->process(samples.data() + begin, count,
                     [&](const WordSpotter::Spotted& spotted) {
                       heard.push_back({spotted, at});
                     });
  }
  return heard;
}

TEST(WordSpotter, HearsItsWordsInTheStream)
{
  WordSpotter spotter(WordNetwork::load(toneNetwork()), LEFT_AND_STOP);
  Samples samples = whiteNoise(4.0, 30.0);
  say(&samples, "left", 1.0);
  say(&samples, "right", 2.0);  // not asked for
  say(&samples, "stop", 3.0);

  const std::vector<SpottedAt> heard = listen(&spotter, samples);

  ASSERT_EQ(2U, heard.size());
  EXPECT_EQ(0U, heard[0].spotted.word);
  EXPECT_EQ(1U, heard[1].spotted.word);
  for (size_t i = 0; i < 2; ++i)
  {
    const WordSpotter::Spotted& spotted = heard[i].spotted;
    const auto begin = static_cast<int64_t>(samplesIn(i == 0 ? 1.0 : 3.0));
    EXPECT_GT(spotted.confidence, 0.3);
    EXPECT_LE(spotted.confidence, 1.0);
    EXPECT_NEAR(static_cast<double>(begin), static_cast<double>(spotted.end), 0.04 * SAMPLE_RATE_HZ);  // two steps
    EXPECT_LT(spotted.begin, spotted.end);
    EXPECT_GT(heard[i].at, spotted.end);
    EXPECT_LT(heard[i].at, begin + SAMPLE_RATE_HZ * 3 / 10);
  }
}

TEST(WordSpotter, TheSizeOfTheChunksDoesNotMatter)
{
  WordSpotter spotter(WordNetwork::load(toneNetwork()), LEFT_AND_STOP);
  Samples samples = whiteNoise(2.0, 30.0);
  say(&samples, "left", 1.0);
  const std::vector<SpottedAt> expected = listen(&spotter, samples, 1);
  ASSERT_EQ(1U, expected.size());
  for (const size_t chunk : {size_t{160}, size_t{1000}, samples.size()})
  {
    spotter.restart(0, [](const WordSpotter::Spotted&) {});
    const std::vector<SpottedAt> heard = listen(&spotter, samples, chunk);
    ASSERT_EQ(1U, heard.size()) << chunk;
    EXPECT_EQ(expected[0].spotted.end, heard[0].spotted.end);
    EXPECT_EQ(expected[0].spotted.confidence, heard[0].spotted.confidence);
  }
}

TEST(WordSpotter, ARestartTellsWhatWaitsAndForgetsTheRest)
{
  WordSpotter spotter(WordNetwork::load(toneNetwork()), LEFT_AND_STOP);
  Samples samples = whiteNoise(2.0, 30.0);
  say(&samples, "left", 1.0);
  samples.resize(samplesIn(1.12));  // the probability still rises
  ASSERT_TRUE(listen(&spotter, samples).empty());
  EXPECT_GT(spotter.best().probability, 0.0);
  std::vector<WordSpotter::Spotted> told;
  const WordSpotter::Sink sink = [&](const WordSpotter::Spotted& spotted) { told.push_back(spotted); };

  spotter.restart(500, sink);

  ASSERT_EQ(1U, told.size());
  EXPECT_EQ(0U, told[0].word);
  EXPECT_EQ(0.0, spotter.best().probability);
  spotter.restart(500, sink);
  EXPECT_EQ(1U, told.size());
}

TEST(WordSpotter, AWordBelowItsThresholdMayBeDoubtful)
{
  Samples samples = whiteNoise(4.0, 30.0);
  say(&samples, "stop", 1.0);
  say(&samples, "left", 2.0);
  say(&samples, "stop", 3.0);

  // No mean probability reaches 1.
  WordSpotter doubting(WordNetwork::load(toneNetwork()), {{"left", 0.5, false}, {"stop", 1.0, true, 0.3}});
  std::vector<SpottedAt> heard = listen(&doubting, samples);
  ASSERT_EQ(3U, heard.size());
  for (const size_t i : {0, 2})
  {
    EXPECT_EQ(1U, heard[i].spotted.word);
    EXPECT_TRUE(heard[i].spotted.doubtful);
    EXPECT_GE(heard[i].spotted.confidence, 0.3);
    EXPECT_LT(heard[i].at, static_cast<int64_t>(samplesIn(i == 0 ? 1.4 : 3.4)));
  }
  EXPECT_EQ(0U, heard[1].spotted.word);
  EXPECT_FALSE(heard[1].spotted.doubtful);

  // Where the threshold is reached, there is no doubt.
  WordSpotter sure(WordNetwork::load(toneNetwork()), {{"stop", 0.5, true, 0.3}});
  heard = listen(&sure, samples);
  ASSERT_EQ(2U, heard.size());
  EXPECT_FALSE(heard[0].spotted.doubtful);
  EXPECT_FALSE(heard[1].spotted.doubtful);
}

TEST(WordSpotter, AWordThatTheNetworkLacksIsAnError)
{
  EXPECT_THROW(WordSpotter(WordNetwork::load(toneNetwork()), {{"halt", 0.5, false}}), std::invalid_argument);
}

}  // namespace
}  // namespace pi_speech
