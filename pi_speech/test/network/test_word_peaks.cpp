#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "network/word_peaks.h"

namespace pi_speech
{
namespace
{

constexpr int GO = 0;
constexpr int STOP = 1;

/// go waits for its peak, stop is fast. The outputs are in another order, beside one for anything else.
WordPeaks goAndStop()
{
  return WordPeaks({{"go", 0.5, false}, {"stop", 0.3, true}}, {1, 0});
}

struct Heard
{
  int step;
  WordPeaks::Peak peak;
};

/// Probabilities of go and stop, step by step.
std::vector<Heard> hear(WordPeaks* peaks, const std::vector<std::pair<float, float>>& steps)
{
  std::vector<Heard> heard;
  for (size_t i = 0; i < steps.size(); ++i)
  {
    const Eigen::Vector3f outputs(steps[i].second, steps[i].first, 1.0F - steps[i].first - steps[i].second);
    if (const auto peak = peaks->add(outputs))
    {
      heard.push_back({static_cast<int>(i), *peak});
    }
  }
  return heard;
}

std::vector<std::pair<float, float>> word(int which, float probability, size_t steps, size_t pause)
{
  const std::pair<float, float> sure =
      which == GO ? std::make_pair(probability, 0.0F) : std::make_pair(0.0F, probability);
  std::vector<std::pair<float, float>> result(steps, sure);
  result.resize(steps + pause, {0.0F, 0.0F});
  return result;
}

std::vector<std::pair<float, float>> join(std::vector<std::pair<float, float>> a,
                                          const std::vector<std::pair<float, float>>& b)
{
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

TEST(WordPeaks, AWordIsHeardOnceAtItsPeak)
{
  WordPeaks peaks = goAndStop();

  const std::vector<Heard> heard = hear(&peaks, word(GO, 0.9F, 6, 20));

  ASSERT_EQ(1U, heard.size());
  EXPECT_EQ(0U, heard[0].peak.word);
  EXPECT_NEAR(0.9, heard[0].peak.probability, 1e-6);
  EXPECT_EQ(6, heard[0].step);            // the first one in which the mean falls
  EXPECT_EQ(7, heard[0].peak.age_steps);  // high since step 0
  EXPECT_NEAR(0.9, peaks.best().probability, 1e-6);
}

TEST(WordPeaks, AFastWordDoesNotWaitForItsPeak)
{
  WordPeaks peaks = goAndStop();

  const std::vector<Heard> heard = hear(&peaks, word(STOP, 0.9F, 10, 20));

  ASSERT_EQ(1U, heard.size());
  EXPECT_EQ(1U, heard[0].peak.word);
  EXPECT_EQ(1, heard[0].step);  // 2 * 0.9 / 5 >= 0.3
}

TEST(WordPeaks, AFaintOrShortWordIsNotHeard)
{
  WordPeaks peaks = goAndStop();

  EXPECT_TRUE(hear(&peaks, join(word(GO, 0.45F, 10, 10), word(GO, 0.9F, 2, 10))).empty());
  EXPECT_NEAR(0.45, peaks.best().probability, 1e-6);
}

TEST(WordPeaks, ALongWordIsToldBeforeItFalls)
{
  WordPeaks peaks = goAndStop();

  const std::vector<Heard> heard = hear(&peaks, word(GO, 0.9F, 40, 10));

  ASSERT_EQ(1U, heard.size());
  EXPECT_LT(heard[0].step, 12);
}

TEST(WordPeaks, AWordThatIsSaidTwiceIsHeardTwice)
{
  WordPeaks peaks = goAndStop();

  EXPECT_EQ(2U, hear(&peaks, join(word(GO, 0.9F, 6, 20), word(GO, 0.9F, 6, 20))).size());
  EXPECT_EQ(2U, hear(&peaks, join(word(STOP, 0.9F, 6, 20), word(STOP, 0.9F, 6, 20))).size());
}

TEST(WordPeaks, OfTwoWordsForOneSoundTheHigherIsHeard)
{
  WordPeaks peaks({{"go", 0.3, false}, {"no", 0.3, false}}, {0, 1});
  std::vector<std::pair<float, float>> steps(3, {0.5F, 0.0F});
  steps.resize(8, {0.1F, 0.8F});
  steps.resize(40, {0.0F, 0.0F});
  int heard = 0;
  for (const auto& [go, no] : steps)
  {
    if (const auto peak = peaks.add(Eigen::Vector2f(go, no)))
    {
      ++heard;
      EXPECT_EQ(1U, peak->word);
    }
  }
  EXPECT_EQ(1, heard);
}

TEST(WordPeaks, AfterAWordOnlyAFastOneIsHeardAtOnce)
{
  WordPeaks peaks = goAndStop();
  const std::vector<Heard> stop = hear(&peaks, join(word(GO, 0.9F, 5, 1), word(STOP, 0.9F, 6, 30)));
  ASSERT_EQ(2U, stop.size());
  EXPECT_EQ(1U, stop[1].peak.word);

  const std::vector<Heard> go = hear(&peaks, join(word(STOP, 0.9F, 5, 1), word(GO, 0.9F, 5, 30)));
  ASSERT_EQ(1U, go.size());
  EXPECT_EQ(1U, go[0].peak.word);
}

TEST(WordPeaks, AWordThatWaitsIsHeardAtTheEnd)
{
  WordPeaks peaks = goAndStop();
  ASSERT_TRUE(hear(&peaks, word(GO, 0.9F, 4, 0)).empty());

  const auto last = peaks.finish();

  ASSERT_TRUE(last);
  EXPECT_EQ(0U, last->word);
  EXPECT_FALSE(peaks.finish());
  EXPECT_EQ(0.0, peaks.best().probability);
  EXPECT_TRUE(hear(&peaks, word(GO, 0.0F, 5, 5)).empty());
}

}  // namespace
}  // namespace pi_speech
