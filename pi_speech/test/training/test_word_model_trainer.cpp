#include "training/word_model_trainer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{
namespace
{

const std::vector<std::string> WORDS{"go", "left", "stop"};
constexpr int WORD_STATES = 4;
constexpr int OTHER = 3;
constexpr int BACKGROUND = 4;

/// A world of sounds: words are sequences of states, each a Gaussian, of lengths that vary; other speech is states of
/// its own in any order; background is one Gaussian that is quieter (first feature) than all.
class World
{
public:
  explicit World(uint32_t seed, float spread = 1.0F) : random_(seed)
  {
    std::mt19937 means(11);  // the world is the same for each seed
    std::normal_distribution<float> normal(0.0F, spread);
    for (int i = 0; i < static_cast<int>(WORDS.size()) * WORD_STATES + 6; ++i)
    {
      Eigen::RowVectorXf mean = Eigen::RowVectorXf::Zero(FEATURES).unaryExpr([&](float) { return normal(means); });
      mean[0] = 8.0F;
      sounds_.push_back(mean);
    }
    background_ = Eigen::RowVectorXf::Zero(FEATURES);
    background_[0] = -8.0F;
  }

  TrainingExample example(int label)
  {
    std::vector<Eigen::RowVectorXf> rows;
    if (label == BACKGROUND)
    {
      append(background_, length(20, 40), &rows);
    }
    else
    {
      append(background_, length(4, 10), &rows);
      for (int s = 0; s < (label == OTHER ? length(2, 5) : WORD_STATES); ++s)
      {
        const int sound =
            label == OTHER ? static_cast<int>(WORDS.size()) * WORD_STATES + length(0, 5) : label * WORD_STATES + s;
        append(sounds_[static_cast<size_t>(sound)], length(3, 8), &rows);
      }
      append(background_, length(4, 10), &rows);
    }
    TrainingExample result;
    result.label = label;
    result.features.resize(static_cast<Eigen::Index>(rows.size()), FEATURES);
    for (size_t t = 0; t < rows.size(); ++t)
    {
      result.features.row(static_cast<Eigen::Index>(t)) = rows[t];
    }
    return result;
  }

  std::vector<TrainingExample> examples(int of_each)
  {
    std::vector<TrainingExample> result;
    for (int i = 0; i < of_each; ++i)
    {
      for (int label = 0; label <= BACKGROUND; ++label)
      {
        result.push_back(example(label));
      }
    }
    return result;
  }

private:
  int length(int least, int most) { return std::uniform_int_distribution<int>(least, most)(random_); }

  void append(const Eigen::RowVectorXf& mean, int count, std::vector<Eigen::RowVectorXf>* rows)
  {
    std::normal_distribution<float> normal;
    for (int i = 0; i < count; ++i)
    {
      rows->push_back(mean + Eigen::RowVectorXf::Zero(FEATURES).unaryExpr([&](float) { return normal(random_); }));
    }
  }

  std::mt19937 random_;
  std::vector<Eigen::RowVectorXf> sounds_;
  Eigen::RowVectorXf background_;
};

TrainerOptions smallOptions()
{
  TrainerOptions options;
  options.states_per_word = WORD_STATES;
  options.components = 2;
  options.filler_states = 8;
  options.filler_components = 2;
  options.background_components = 2;
  options.likelihood_passes = 4;
  options.epochs = 6;
  options.rate = 0.01;
  options.batch = 16;
  options.threads = 2;
  return options;
}

struct Judgement
{
  double right = 0.0;          ///< share
  double cross_entropy = 0.0;  ///< mean
};

Judgement judge(const WordModels& models, const std::vector<TrainingExample>& examples)
{
  const WordScorer scorer(models);
  Judgement result;
  for (const TrainingExample& example : examples)
  {
    const std::vector<float> posteriors = classPosteriors(scorer.score(example.features, {{0}, {1}, {2}}));
    const auto best = std::max_element(posteriors.begin(), posteriors.end()) - posteriors.begin();
    result.right += best == example.label ? 1.0 : 0.0;
    result.cross_entropy -= std::log(std::max(1e-30F, posteriors[static_cast<size_t>(example.label)]));
  }
  result.right /= static_cast<double>(examples.size());
  result.cross_entropy /= static_cast<double>(examples.size());
  return result;
}

void ignore(const std::string&, int, double) {}

std::string errorOf(const std::function<void()>& call)
{
  try
  {
    call();
    return "";
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
}

void expectSame(const WordModels& a, const WordModels& b)
{
  EXPECT_EQ(a.word_mixtures.means, b.word_mixtures.means);
  EXPECT_EQ(a.word_mixtures.log_variances, b.word_mixtures.log_variances);
  EXPECT_EQ(a.word_mixtures.log_weights, b.word_mixtures.log_weights);
  EXPECT_EQ(a.filler.means, b.filler.means);
  EXPECT_EQ(a.background.means, b.background.means);
  EXPECT_EQ(a.scale, b.scale);
  EXPECT_EQ(a.word_biases, b.word_biases);
}

TEST(WordModelTrainer, LearnsWordsFromExamples)
{
  const TrainerOptions options = smallOptions();

  const WordModels models = trainLikelihood(WORDS, World(1).examples(40), options, ignore);

  EXPECT_NO_THROW(models.validate());
  EXPECT_EQ(WORDS, models.words);
  EXPECT_EQ(options.states_per_word, models.states_per_word);
  EXPECT_EQ(options.components, models.word_mixtures.components);
  EXPECT_EQ(options.filler_states, models.filler.states);
  EXPECT_EQ(options.filler_components, models.filler.components);
  EXPECT_EQ(options.background_components, models.background.components);
  EXPECT_GT(judge(models, World(2).examples(40)).right, 0.95);
}

TEST(WordModelTrainer, TheLikelihoodNeverFallsWithTheSameComponents)
{
  TrainerOptions options = smallOptions();
  options.likelihood_passes = 6;
  std::vector<double> losses;
  const TrainingProgress progress = [&](const std::string&, int pass, double loss)
  {
    EXPECT_EQ(static_cast<int>(losses.size()) + 1, pass);
    losses.push_back(loss);
  };

  trainLikelihood(WORDS, World(3, 0.4F).examples(30), options, progress);

  // One and two components.
  ASSERT_EQ(12U, losses.size());
  for (size_t i = 0; i < losses.size(); ++i)
  {
    if (i % 6 != 0)
    {
      // The prior of the variances is no part of the likelihood: close to the end it may cost a little.
      EXPECT_LT(losses[i], losses[i - 1] + 1e-3 * std::abs(losses[i - 1])) << "pass " << i + 1;
    }
  }
  EXPECT_LT(losses[5], losses[0]);
  EXPECT_LT(losses[11], losses[5]);
}

TEST(WordModelTrainer, FindsTheGaussiansOfTheWords)
{
  TrainerOptions options = smallOptions();
  options.components = options.filler_components = options.background_components = 1;
  options.likelihood_passes = 10;
  const std::vector<TrainingExample> examples = World(4).examples(60);

  const WordModels models = trainLikelihood(WORDS, examples, options, ignore);

  // The background's true values: mean -8 in the first feature and 0 in the others, variance 1 (and a prior).
  Eigen::RowVectorXf expected = Eigen::RowVectorXf::Zero(FEATURES);
  expected[0] = -8.0F;
  EXPECT_LT((models.background.means.row(0) - expected).cwiseAbs().maxCoeff(), 0.2F);
  EXPECT_LT(models.background.log_variances.row(0).tail(FEATURES - 1).cwiseAbs().maxCoeff(), 0.3F);
}

TEST(WordModelTrainer, ThePosteriorOfTheRightAnswerRises)
{
  // Sounds that are hard to tell apart.
  const std::vector<TrainingExample> examples = World(5, 0.25F).examples(40);
  const std::vector<TrainingExample> held_out = World(6, 0.25F).examples(40);
  const TrainerOptions options = smallOptions();
  WordModels models = trainLikelihood(WORDS, examples, options, ignore);
  const Judgement before = judge(models, examples);
  const Judgement before_held_out = judge(models, held_out);
  std::vector<double> losses;

  trainPosterior(&models, examples, options, [&](const std::string&, int, double loss) { losses.push_back(loss); });

  ASSERT_EQ(static_cast<size_t>(options.epochs), losses.size());
  EXPECT_LT(losses.back(), losses.front());
  EXPECT_NO_THROW(models.validate());
  const Judgement after = judge(models, examples);
  EXPECT_LT(after.cross_entropy, 0.8 * before.cross_entropy);
  EXPECT_GE(after.right, before.right);
  EXPECT_LT(judge(models, held_out).cross_entropy, before_held_out.cross_entropy);
}

TEST(WordModelTrainer, TheSameSeedGivesTheSameModels)
{
  const std::vector<TrainingExample> examples = World(7).examples(10);
  TrainerOptions options = smallOptions();
  options.epochs = 2;
  WordModels models[2];
  for (WordModels& each : models)
  {
    each = trainLikelihood(WORDS, examples, options, ignore);
    trainPosterior(&each, examples, options, ignore);
  }

  expectSame(models[0], models[1]);
}

TEST(WordModelTrainer, NoPassesOfThePosteriorChangeNothing)
{
  const std::vector<TrainingExample> examples = World(7).examples(5);
  TrainerOptions options = smallOptions();
  options.epochs = 0;
  const WordModels before = trainLikelihood(WORDS, examples, options, ignore);
  WordModels after = before;

  trainPosterior(&after, examples, options, ignore);

  expectSame(before, after);
}

TEST(WordModelTrainer, AnExampleTooShortForItsWordDoesNotSpoilTheModels)
{
  std::vector<TrainingExample> examples = World(8).examples(20);
  TrainingExample brief = examples[0];
  brief.features = FeatureMatrix(brief.features.topRows(1));
  examples.push_back(brief);
  const TrainerOptions options = smallOptions();

  WordModels models = trainLikelihood(WORDS, examples, options, ignore);
  trainPosterior(&models, examples, options, ignore);

  EXPECT_NO_THROW(models.validate());
  EXPECT_GT(judge(models, World(9).examples(20)).right, 0.95);
}

TEST(WordModelTrainer, EachClassNeedsAnExample)
{
  const std::map<int, std::string> names{
      {0, "the word go"}, {2, "the word stop"}, {OTHER, "other speech"}, {BACKGROUND, "the background"}};
  const std::vector<TrainingExample> all = World(10).examples(2);
  const WordModels models = trainLikelihood(WORDS, all, smallOptions(), ignore);
  for (const auto& [label, name] : names)
  {
    std::vector<TrainingExample> examples;
    std::copy_if(all.begin(), all.end(), std::back_inserter(examples),
                 [left_out = label](const TrainingExample& example) { return example.label != left_out; });
    WordModels copy = models;
    for (const std::string& error : {errorOf([&] { trainLikelihood(WORDS, examples, smallOptions(), ignore); }),
                                     errorOf([&] { trainPosterior(&copy, examples, smallOptions(), ignore); })})
    {
      EXPECT_NE(std::string::npos, error.find(name)) << error;
    }
  }
}

TEST(WordModelTrainer, AnExampleOfNoClassIsAnError)
{
  std::vector<TrainingExample> examples = World(10).examples(2);
  examples.back().label = BACKGROUND + 1;
  EXPECT_NE("", errorOf([&] { trainLikelihood(WORDS, examples, smallOptions(), ignore); }));
  examples.back().label = -1;
  EXPECT_NE("", errorOf([&] { trainLikelihood(WORDS, examples, smallOptions(), ignore); }));
}

TEST(WordModelTrainer, BadOptionsAreNamed)
{
  const auto error = [](const std::function<void(TrainerOptions*)>& change)
  {
    TrainerOptions options;
    change(&options);
    return errorOf([&] { options.validate(); });
  };
  EXPECT_EQ("", error([](TrainerOptions*) {}));
  EXPECT_EQ(0U, error([](auto* o) { o->states_per_word = 0; }).find("states_per_word = 0, must be in ["));
  EXPECT_EQ(0U, error([](auto* o) { o->components = 3; }).find("components = 3, must be a power of 2"));
  EXPECT_EQ(0U, error([](auto* o) { o->filler_components = 0; }).find("filler_components = 0"));
  EXPECT_EQ(0U, error([](auto* o) { o->background_components = 6; }).find("background_components = 6"));
  EXPECT_EQ(0U, error([](auto* o) { o->filler_states = 0; }).find("filler_states = 0"));
  EXPECT_EQ(0U, error([](auto* o) { o->likelihood_passes = 0; }).find("likelihood_passes = 0"));
  EXPECT_EQ(0U, error([](auto* o) { o->epochs = -1; }).find("epochs = -1"));
  EXPECT_EQ(0U, error([](auto* o) { o->rate = 0.0; }).find("rate = 0"));
  EXPECT_EQ(0U, error([](auto* o) { o->rate = std::nan(""); }).find("rate = "));
  EXPECT_EQ(0U, error([](auto* o) { o->other_weight = 0.0; }).find("other_weight = 0"));
  EXPECT_EQ(0U, error([](auto* o) { o->batch = 0; }).find("batch = 0"));
  EXPECT_EQ(0U, error([](auto* o) { o->threads = 0; }).find("threads = 0"));
}

TEST(ClassPosteriors, SumToOneInTheOrderOfTheClasses)
{
  WordScorer::Scores scores;
  scores.sequences = {1000.0F, 1001.0F, -std::numeric_limits<float>::infinity()};
  scores.filler = 999.0F;
  scores.background = -2000.0F;

  const std::vector<float> posteriors = classPosteriors(scores);

  ASSERT_EQ(5U, posteriors.size());
  const float sum = std::exp(-1.0F) + 1.0F + std::exp(-2.0F);
  EXPECT_NEAR(std::exp(-1.0F) / sum, posteriors[0], 1e-5F);
  EXPECT_NEAR(1.0F / sum, posteriors[1], 1e-5F);
  EXPECT_EQ(0.0F, posteriors[2]);
  EXPECT_NEAR(std::exp(-2.0F) / sum, posteriors[3], 1e-5F);
  EXPECT_NEAR(0.0F, posteriors[4], 1e-5F);
}

TEST(WordModelTrainer, AnExampleWithoutFramesIsNoCrash)
{
  std::vector<TrainingExample> examples = World(10).examples(5);
  for (const int label : {0, OTHER, BACKGROUND})
  {
    TrainingExample empty;
    empty.label = label;
    examples.push_back(empty);
  }

  // Left out or refused.
  try
  {
    WordModels models = trainLikelihood(WORDS, examples, smallOptions(), ignore);
    trainPosterior(&models, examples, smallOptions(), ignore);
    EXPECT_NO_THROW(models.validate());
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STRNE("", error.what());
  }
}

}  // namespace
}  // namespace pi_speech
