#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include "hmm/word_models.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

namespace fs = std::filesystem;

constexpr int STATES = 3;

DiagonalMixtures mixturesOfModels(int states, int components, uint32_t seed)
{
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  DiagonalMixtures mixtures(states, components);
  mixtures.means = mixtures.means.unaryExpr([&](float) { return 2.0F * normal(random); });
  mixtures.log_variances = mixtures.log_variances.unaryExpr([&](float) { return 0.3F * normal(random); });
  return mixtures;
}

WordModels randomModels()
{
  WordModels models;
  models.words = {"go", "left", "x-ray"};
  models.states_per_word = STATES;
  models.word_mixtures = mixturesOfModels(3 * STATES, 2, 1);
  models.filler = mixturesOfModels(4, 2, 2);
  models.background = mixturesOfModels(1, 2, 3);
  models.scale = 0.25F;
  models.word_biases = {0.5F, -1.0F, 2.0F};
  models.filler_bias = 0.125F;
  models.background_bias = -3.0F;
  return models;
}

void appendFrames(const DiagonalMixtures& mixtures, int state, int count, std::mt19937* random,
                  std::vector<Eigen::RowVectorXf>* rows)
{
  std::normal_distribution<float> normal;
  for (int i = 0; i < count; ++i)
  {
    const Eigen::Index row = static_cast<Eigen::Index>(state) * mixtures.components;
    const Eigen::RowVectorXf noise =
        Eigen::RowVectorXf::Zero(FEATURES).unaryExpr([&](float) { return normal(*random); });
    rows->push_back(mixtures.means.row(row) +
                    noise.cwiseProduct((0.5F * mixtures.log_variances.row(row)).array().exp().matrix()));
  }
}

/// What these models generate for a sequence of words, with background around each.
FeatureMatrix speak(const WordModels& models, const WordSequence& sequence, uint32_t seed)
{
  std::mt19937 random(seed);
  std::vector<Eigen::RowVectorXf> rows;
  appendFrames(models.background, 0, 5, &random, &rows);
  for (const int word : sequence)
  {
    for (int s = 0; s < STATES; ++s)
    {
      appendFrames(models.word_mixtures, word * STATES + s, 4, &random, &rows);
    }
    appendFrames(models.background, 0, 5, &random, &rows);
  }
  FeatureMatrix features(static_cast<Eigen::Index>(rows.size()), FEATURES);
  for (size_t t = 0; t < rows.size(); ++t)
  {
    features.row(static_cast<Eigen::Index>(t)) = rows[t];
  }
  return features;
}

std::string bytesOf(const std::string& path)
{
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

std::string loadErrorOf(const std::string& path)
{
  try
  {
    WordModels::load(path);
    return "";
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
}

std::string modelsError(const std::function<void(WordModels*)>& change)
{
  WordModels models = randomModels();
  change(&models);
  try
  {
    models.validate();
    return "";
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
}

bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

class WordModelsFile : public testing::Test
{
protected:
  void SetUp() override
  {
    path_ = folder_.path() + "/models.bin";
    randomModels().save(path_);
    bytes_ = bytesOf(path_);
    ASSERT_GT(bytes_.size(), 1000U);
  }

  const TemporaryFolder folder_;
  std::string path_;
  std::string bytes_;
};

TEST(WordModels, FindsItsWords)
{
  const WordModels models = randomModels();

  EXPECT_EQ(0, models.find("go"));
  EXPECT_EQ(2, models.find("x-ray"));
  EXPECT_EQ(-1, models.find("right"));
  EXPECT_EQ(-1, models.find(""));
  EXPECT_EQ(1, WordScorer(models).find("left"));
  EXPECT_EQ(models.words, WordScorer(models).words());
}

TEST(WordModels, WhatDoesNotFitIsAnError)
{
  EXPECT_EQ("", modelsError([](WordModels*) {}));
  EXPECT_NE("", modelsError([](auto* m) { m->words.clear(); }));
  EXPECT_NE("", modelsError([](auto* m) { m->words.push_back("on"); }));
  EXPECT_NE("", modelsError([](auto* m) { m->states_per_word = 2; }));
  EXPECT_NE("", modelsError([](auto* m) { m->states_per_word = 0; }));
  EXPECT_NE("", modelsError([](auto* m) { m->word_biases.pop_back(); }));
  EXPECT_NE("", modelsError([](auto* m) { m->background = mixturesOfModels(2, 2, 3); }));
  EXPECT_NE("", modelsError([](auto* m) { m->filler = DiagonalMixtures(); }));
  EXPECT_NE("", modelsError([](auto* m) { m->word_mixtures.means(0, 0) = std::nanf(""); }));
  EXPECT_NE("", modelsError([](auto* m) { m->scale = std::nanf(""); }));
  EXPECT_NE("", modelsError([](auto* m) { m->word_biases[1] = std::numeric_limits<float>::infinity(); }));
}

TEST_F(WordModelsFile, IsReadAsItWasWritten)
{
  const WordModels expected = randomModels();

  const WordModels models = WordModels::load(path_);

  EXPECT_EQ(expected.words, models.words);
  EXPECT_EQ(expected.states_per_word, models.states_per_word);
  for (const auto& [a, b] :
       {std::pair<const DiagonalMixtures*, const DiagonalMixtures*>{&expected.word_mixtures, &models.word_mixtures},
        {&expected.filler, &models.filler},
        {&expected.background, &models.background}})
  {
    EXPECT_EQ(a->states, b->states);
    EXPECT_EQ(a->components, b->components);
    EXPECT_EQ(a->means, b->means);
    EXPECT_EQ(a->log_variances, b->log_variances);
    EXPECT_EQ(a->log_weights, b->log_weights);
  }
  EXPECT_EQ(expected.scale, models.scale);
  EXPECT_EQ(expected.word_biases, models.word_biases);
  EXPECT_EQ(expected.filler_bias, models.filler_bias);
  EXPECT_EQ(expected.background_bias, models.background_bias);
}

TEST_F(WordModelsFile, ReplacesTheOneBeforeAndLeavesNothingElse)
{
  WordModels other = randomModels();
  other.scale = 0.75F;

  other.save(path_);

  EXPECT_EQ(0.75F, WordModels::load(path_).scale);
  EXPECT_EQ(1, std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()));
}

TEST_F(WordModelsFile, IsAnErrorWhereverItIsTruncated)
{
  for (size_t size = 0; size < bytes_.size(); size += size < 100 ? 1 : 97)
  {
    const std::string path = folder_.file("short.bin", bytes_.substr(0, size));
    const std::string error = loadErrorOf(path);
    EXPECT_EQ(0U, error.find(path + ": ")) << size << " bytes: " << error;
  }
}

TEST_F(WordModelsFile, IsAnErrorWhereverAByteIsAltered)
{
  for (size_t at = 0; at < bytes_.size(); at += at < 100 ? 1 : 31)
  {
    std::string altered = bytes_;
    altered[at] = static_cast<char>(altered[at] ^ 0x10);
    const std::string path = folder_.file("altered.bin", altered);
    const std::string error = loadErrorOf(path);
    EXPECT_EQ(0U, error.find(path + ": ")) << "byte " << at << ": " << error;
  }
}

TEST_F(WordModelsFile, IsAnErrorWithBytesBehindIt)
{
  const std::string path = folder_.file("long.bin", bytes_ + "x");

  EXPECT_EQ(0U, loadErrorOf(path).find(path + ": "));
}

TEST_F(WordModelsFile, OfAnotherKindIsNamed)
{
  const std::string text = folder_.file("text.bin", std::string(5000, 'a'));
  const std::string empty = folder_.file("empty.bin", "");

  EXPECT_TRUE(contains(loadErrorOf(text), text + ": this is no file of word models")) << loadErrorOf(text);
  EXPECT_EQ(0U, loadErrorOf(empty).find(empty + ": "));
}

TEST_F(WordModelsFile, ThatIsMissingOrAFolderIsNamed)
{
  const std::string missing = folder_.path() + "/missing.bin";

  EXPECT_EQ(0U, loadErrorOf(missing).find(missing + ": "));
  EXPECT_TRUE(contains(loadErrorOf(missing), "No such file")) << loadErrorOf(missing);
  EXPECT_EQ(0U, loadErrorOf(folder_.path()).find(folder_.path() + ": "));
}

TEST_F(WordModelsFile, ThatCannotBeWrittenIsNamed)
{
  const std::string folder = folder_.path() + "/folder";
  fs::create_directory(folder);
  for (const std::string& path : {folder_.path() + "/nowhere/models.bin", folder})
  {
    try
    {
      randomModels().save(path);
      ADD_FAILURE() << path;
    }
    catch (const std::runtime_error& error)
    {
      EXPECT_TRUE(contains(error.what(), path)) << error.what();
    }
  }
  // Nothing of a file that was not completed stays.
  EXPECT_EQ(2, std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()));
}

TEST(WordScorer, TheWordsThatWereSpokenScoreBest)
{
  const WordModels models = randomModels();
  const WordScorer scorer(models);
  const std::vector<WordSequence> sequences{{0}, {1}, {2}, {0, 1}, {1, 0}, {2, 1}, {0, 1, 2}};
  for (size_t spoken = 0; spoken < sequences.size(); ++spoken)
  {
    for (uint32_t seed = 1; seed <= 3; ++seed)
    {
      const WordScorer::Scores scores = scorer.score(speak(models, sequences[spoken], seed), sequences);

      ASSERT_EQ(sequences.size(), scores.sequences.size());
      const auto best = std::max_element(scores.sequences.begin(), scores.sequences.end());
      EXPECT_EQ(spoken, static_cast<size_t>(best - scores.sequences.begin()));
      EXPECT_GT(*best, scores.filler);
      EXPECT_GT(*best, scores.background);
    }
  }
}

TEST(WordScorer, BackgroundAndOtherSpeechScoreBestAsSuch)
{
  const WordModels models = randomModels();
  const WordScorer scorer(models);
  const std::vector<WordSequence> sequences{{0}, {1}, {2}};
  std::mt19937 random(1);
  std::vector<Eigen::RowVectorXf> rows;
  appendFrames(models.background, 0, 30, &random, &rows);
  FeatureMatrix features(30, FEATURES);
  for (int t = 0; t < 30; ++t)
  {
    features.row(t) = rows[static_cast<size_t>(t)];
  }
  const WordScorer::Scores background = scorer.score(features, sequences);
  rows.clear();
  for (const int state : {2, 0, 3, 1, 0, 2})
  {
    appendFrames(models.filler, state, 5, &random, &rows);
  }
  for (int t = 0; t < 30; ++t)
  {
    features.row(t) = rows[static_cast<size_t>(t)];
  }
  const WordScorer::Scores filler = scorer.score(features, sequences);

  EXPECT_GT(background.background, background.filler);
  EXPECT_GT(background.background, *std::max_element(background.sequences.begin(), background.sequences.end()));
  EXPECT_GT(filler.filler, filler.background);
  EXPECT_GT(filler.filler, *std::max_element(filler.sequences.begin(), filler.sequences.end()));
}

TEST(WordScorer, ScaleAndBiasesMakeLogitsOfLikelihoods)
{
  WordModels models = randomModels();
  models.scale = 1.0F;
  models.word_biases = {0.0F, 0.0F, 0.0F};
  models.filler_bias = models.background_bias = 0.0F;
  const FeatureMatrix features = speak(models, {0, 1}, 5);
  const std::vector<WordSequence> sequences{{0}, {0, 1}, {1, 1}};
  const WordScorer::Scores likelihoods = WordScorer(models).score(features, sequences);
  const WordModels scaled = randomModels();

  const WordScorer::Scores logits = WordScorer(scaled).score(features, sequences);

  // 1e-5 of scores of some thousand.
  const std::vector<float> biases{0.5F, 0.5F - 1.0F, -1.0F - 1.0F};
  for (size_t i = 0; i < sequences.size(); ++i)
  {
    EXPECT_NEAR(scaled.scale * likelihoods.sequences[i] + biases[i], logits.sequences[i], 0.02F);
  }
  EXPECT_NEAR(scaled.scale * likelihoods.filler + scaled.filler_bias, logits.filler, 0.02F);
  EXPECT_NEAR(scaled.scale * likelihoods.background + scaled.background_bias, logits.background, 0.02F);
}

TEST(WordScorer, WhatIsTooShortForAModelIsImpossible)
{
  const WordModels models = randomModels();
  const FeatureMatrix features = speak(models, {0}, 1).topRows(3);
  const WordScorer scorer(models);

  const WordScorer::Scores scores = scorer.score(features, {{0}, {0, 1, 2}});

  EXPECT_TRUE(std::isfinite(scores.sequences[0]));  // every second of its states may be skipped
  EXPECT_EQ(-std::numeric_limits<float>::infinity(), scores.sequences[1]);
  EXPECT_EQ(-std::numeric_limits<float>::infinity(), scorer.score(FeatureMatrix(0, FEATURES), {{0}}).sequences[0]);
  EXPECT_TRUE(scorer.score(features, {}).sequences.empty());
}

TEST(WordScorer, RefusesModelsThatDoNotFit)
{
  WordModels models = randomModels();
  models.word_biases.pop_back();

  EXPECT_THROW(WordScorer{models}, std::invalid_argument);
}

}  // namespace
}  // namespace pi_speech
