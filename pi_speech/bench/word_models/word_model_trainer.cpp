#include "word_models/word_model_trainer.h"

#include "hmm/forward_backward.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <stdexcept>
#include <thread>

namespace pi_speech
{

namespace
{

using Doubles = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Share of the loudness range above which a frame is taken for speech, to begin with.
constexpr float LOUD_SHARE = 0.35F;
constexpr Eigen::Index MARGIN_FRAMES = 3;
/// Occupancy below which a Gaussian keeps its mean.
constexpr double LEAST_OCCUPANCY = 3.0;
/// A tenth of the variance of all frames, in the place of so many frames, keeps variances away from zero.
constexpr double PRIOR_FRAMES = 5.0;
constexpr float SPLIT = 0.2F;  ///< of a standard deviation
constexpr int KMEANS_PASSES = 10;
constexpr float LABEL_SMOOTHING = 0.02F;

/// First and second moments of the frames that components have taken.
struct Moments
{
  Doubles first;
  Doubles second;
  Eigen::VectorXd count;

  explicit Moments(const DiagonalMixtures& mixtures)
    : first(Doubles::Zero(mixtures.means.rows(), FEATURES))
    , second(Doubles::Zero(mixtures.means.rows(), FEATURES))
    , count(Eigen::VectorXd::Zero(mixtures.means.rows()))
  {
  }

  /// @param shares     frames x components, for those from first_row on.
  void add(const FeatureMatrix& features, const RowMatrix& shares, Eigen::Index first_row = 0)
  {
    const RowMatrix transposed = shares.transpose();
    const Eigen::Index rows = transposed.rows();
    first.middleRows(first_row, rows) += (transposed * features).cast<double>();
    second.middleRows(first_row, rows) += (transposed * features.cwiseAbs2()).cast<double>();
    count.segment(first_row, rows) += shares.colwise().sum().transpose().cast<double>();
  }

  void add(const Moments& other)
  {
    first += other.first;
    second += other.second;
    count += other.count;
  }
};

/// p(k | x_t, s) times a weight of each state.
RowMatrix componentShares(const RowMatrix& components, const RowMatrix& states, const RowMatrix& weights)
{
  const Eigen::Index per_state = components.cols() / states.cols();
  RowMatrix shares(components.rows(), components.cols());
  for (Eigen::Index s = 0; s < states.cols(); ++s)
  {
    shares.middleCols(s * per_state, per_state) =
        (components.middleCols(s * per_state, per_state).colwise() - states.col(s)).array().exp().colwise() *
        weights.col(s).array();
  }
  return shares;
}

/// Calls work(worker, first, last) for parts of [0, count), each on a thread.
void inParallel(int threads, size_t count, const std::function<void(size_t, size_t, size_t)>& work)
{
  std::vector<std::thread> workers;
  const auto parts = static_cast<size_t>(threads);
  for (size_t i = 0; i < parts; ++i)
  {
    workers.emplace_back(work, i, count * i / parts, count * (i + 1) / parts);
  }
  for (std::thread& worker : workers)
  {
    worker.join();
  }
}

/// Emissions of all models for one utterance.
struct Emissions
{
  RowMatrix word_components;
  RowMatrix filler_components;
  RowMatrix background_components;
  RowMatrix words;  ///< the background is the last column
  RowMatrix filler;
  RowMatrix background;
};

struct Scorers
{
  MixtureScorer words;
  MixtureScorer filler;
  MixtureScorer background;

  explicit Scorers(const WordModels& models)
    : words(models.word_mixtures), filler(models.filler), background(models.background)
  {
  }

  Emissions operator()(const FeatureMatrix& features) const
  {
    Emissions result;
    result.word_components = words.components(features);
    result.filler_components = filler.components(features);
    result.background_components = background.components(features);
    const RowMatrix states = words.states(result.word_components);
    result.filler = filler.states(result.filler_components);
    result.background = background.states(result.background_components);
    result.words.resize(states.rows(), states.cols() + 1);
    result.words << states, result.background;
    return result;
  }
};

std::vector<int> chainOf(int word, int states_per_word, int words)
{
  std::vector<int> columns{words * states_per_word};
  for (int s = 0; s < states_per_word; ++s)
  {
    columns.push_back(word * states_per_word + s);
  }
  columns.push_back(words * states_per_word);
  return columns;
}

/// Occupancies of all states, summed over models with weights.
struct Occupancies
{
  RowMatrix words;
  RowMatrix filler;
  RowMatrix background;

  explicit Occupancies(const Emissions& emissions)
    : words(RowMatrix::Zero(emissions.words.rows(), emissions.words.cols() - 1))
    , filler(RowMatrix::Zero(emissions.filler.rows(), emissions.filler.cols()))
    , background(RowMatrix::Zero(emissions.background.rows(), 1))
  {
  }

  void addChain(const std::vector<int>& columns, const RowMatrix& chain, float weight)
  {
    for (size_t s = 0; s < columns.size(); ++s)
    {
      const auto column = static_cast<Eigen::Index>(s);
      if (columns[s] == words.cols())
      {
        background.col(0) += weight * chain.col(column);
      }
      else
      {
        words.col(columns[s]) += weight * chain.col(column);
      }
    }
  }
};

struct AllMoments
{
  Moments words;
  Moments filler;
  Moments background;
  double loss = 0.0;
  double weight = 0.0;
  double scale = 0.0;  ///< gradients of the posterior's parameters
  Eigen::VectorXd biases;

  explicit AllMoments(const WordModels& models)
    : words(models.word_mixtures)
    , filler(models.filler)
    , background(models.background)
    , biases(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(models.words.size()) + 2))
  {
  }

  void add(const AllMoments& other)
  {
    words.add(other.words);
    filler.add(other.filler);
    background.add(other.background);
    loss += other.loss;
    weight += other.weight;
    scale += other.scale;
    biases += other.biases;
  }

  void addOccupancies(const FeatureMatrix& features, const Emissions& emissions, const Occupancies& occupancies)
  {
    const RowMatrix states = emissions.words.leftCols(emissions.words.cols() - 1);
    words.add(features, componentShares(emissions.word_components, states, occupancies.words));
    filler.add(features, componentShares(emissions.filler_components, emissions.filler, occupancies.filler));
    background.add(features,
                   componentShares(emissions.background_components, emissions.background, occupancies.background));
  }
};

/// The step of maximisation.
void maximise(const Moments& moments, const Eigen::VectorXd& prior_variance, DiagonalMixtures* mixtures)
{
  for (int s = 0; s < mixtures->states; ++s)
  {
    const Eigen::Index first = static_cast<Eigen::Index>(s) * mixtures->components;
    const double all = moments.count.segment(first, mixtures->components).sum();
    for (Eigen::Index row = first; row < first + mixtures->components; ++row)
    {
      const double count = moments.count[row];
      mixtures->log_weights[row] = static_cast<float>(std::log((count + 1.0) / (all + mixtures->components)));
      if (count < LEAST_OCCUPANCY)
      {
        continue;
      }
      const Eigen::RowVectorXd mean = moments.first.row(row) / count;
      const Eigen::RowVectorXd variance = (moments.second.row(row) / count - mean.cwiseAbs2()).cwiseMax(0.0);
      const Eigen::RowVectorXd kept =
          ((variance * count + 2.0 * PRIOR_FRAMES * prior_variance.transpose()) / (count + PRIOR_FRAMES))
              .cwiseMax(0.5 * prior_variance.transpose());
      mixtures->means.row(row) = mean.cast<float>();
      mixtures->log_variances.row(row) = kept.array().log().matrix().cast<float>();
    }
  }
}

/// Twice the components, each half to either side.
void split(DiagonalMixtures* mixtures)
{
  DiagonalMixtures result(mixtures->states, 2 * mixtures->components);
  for (int s = 0; s < mixtures->states; ++s)
  {
    for (int k = 0; k < mixtures->components; ++k)
    {
      const Eigen::Index from = static_cast<Eigen::Index>(s) * mixtures->components + k;
      for (int side = 0; side < 2; ++side)
      {
        const Eigen::Index to = static_cast<Eigen::Index>(s) * result.components + side * mixtures->components + k;
        const float direction = side == 0 ? SPLIT : -SPLIT;
        result.means.row(to) =
            mixtures->means.row(from).array() + direction * (0.5F * mixtures->log_variances.row(from).array()).exp();
        result.log_variances.row(to) = mixtures->log_variances.row(from);
        result.log_weights[to] = mixtures->log_weights[from] - std::log(2.0F);
      }
    }
  }
  *mixtures = result;
}

/// Frames from the first loud one to the last, with a margin.
std::pair<Eigen::Index, Eigen::Index> loudPart(const FeatureMatrix& features)
{
  const Eigen::VectorXf loudness = features.col(0);
  const float least = loudness.minCoeff();
  const float limit = least + LOUD_SHARE * (loudness.maxCoeff() - least);
  Eigen::Index first = 0;
  Eigen::Index last = features.rows() - 1;
  while (first < last && loudness[first] < limit)
  {
    ++first;
  }
  while (last > first && loudness[last] < limit)
  {
    --last;
  }
  return {std::max<Eigen::Index>(0, first - MARGIN_FRAMES), std::min(features.rows(), last + 1 + MARGIN_FRAMES)};
}

/// Centres of the filler's states by k-means over speech.
RowMatrix clusterSpeech(const std::vector<TrainingExample>& examples, int count, const Eigen::RowVectorXf& deviation,
                        uint32_t seed)
{
  Eigen::Index frames = 0;
  for (const TrainingExample& example : examples)
  {
    const auto [first, last] = loudPart(example.features);
    frames += last - first;
  }
  RowMatrix speech(frames, FEATURES);
  Eigen::Index at = 0;
  for (const TrainingExample& example : examples)
  {
    const auto [first, last] = loudPart(example.features);
    speech.middleRows(at, last - first) = example.features.middleRows(first, last - first);
    at += last - first;
  }
  speech.array().rowwise() /= deviation.array();
  std::mt19937 random(seed);
  RowMatrix centres(count, FEATURES);
  for (int k = 0; k < count; ++k)
  {
    centres.row(k) = speech.row(std::uniform_int_distribution<Eigen::Index>(0, frames - 1)(random));
  }
  for (int pass = 0; pass < KMEANS_PASSES; ++pass)
  {
    const RowMatrix products = speech * centres.transpose();
    const Eigen::RowVectorXf norms = centres.rowwise().squaredNorm().transpose();
    Doubles sums = Doubles::Zero(count, FEATURES);
    Eigen::VectorXd counts = Eigen::VectorXd::Zero(count);
    for (Eigen::Index t = 0; t < frames; ++t)
    {
      Eigen::Index nearest = 0;
      (norms - 2.0F * products.row(t)).minCoeff(&nearest);
      sums.row(nearest) += speech.row(t).cast<double>();
      counts[nearest] += 1.0;
    }
    for (int k = 0; k < count; ++k)
    {
      if (counts[k] > 0.0)
      {
        centres.row(k) = (sums.row(k) / counts[k]).cast<float>();
      }
    }
  }
  centres.array().rowwise() *= deviation.array();
  return centres;
}

/// One scorer per word: an example needs that of its own word only.
struct LikelihoodScorers
{
  std::vector<MixtureScorer> words;
  MixtureScorer filler;
  MixtureScorer background;
  Eigen::Index rows_per_word;

  explicit LikelihoodScorers(const WordModels& models)
    : filler(models.filler)
    , background(models.background)
    , rows_per_word(static_cast<Eigen::Index>(models.states_per_word) * models.word_mixtures.components)
  {
    for (size_t w = 0; w < models.words.size(); ++w)
    {
      const Eigen::Index first = static_cast<Eigen::Index>(w) * rows_per_word;
      DiagonalMixtures word(models.states_per_word, models.word_mixtures.components);
      word.means = models.word_mixtures.means.middleRows(first, rows_per_word);
      word.log_variances = models.word_mixtures.log_variances.middleRows(first, rows_per_word);
      word.log_weights = models.word_mixtures.log_weights.segment(first, rows_per_word);
      words.emplace_back(word);
    }
  }
};

/// The step of expectation for one example.
void addOccupancies(const LikelihoodScorers& scorers, const TrainingExample& example, AllMoments* sums)
{
  const auto words = static_cast<int>(scorers.words.size());
  const RowMatrix background_components = scorers.background.components(example.features);
  const RowMatrix background = scorers.background.states(background_components);
  RowMatrix background_occupancies = RowMatrix::Ones(background.rows(), 1);
  double score = 0.0;
  if (example.label < words)
  {
    const MixtureScorer& scorer = scorers.words[static_cast<size_t>(example.label)];
    const RowMatrix components = scorer.components(example.features);
    const RowMatrix states = scorer.states(components);
    RowMatrix emissions(states.rows(), states.cols() + 1);
    emissions << states, background;
    const std::vector<int> columns = chainOf(0, scorer.states(), 1);
    RowMatrix chain;
    score = chainScore(emissions, columns, &chain);
    if (!std::isfinite(score))
    {
      return;  // too short
    }
    sums->words.add(example.features, componentShares(components, states, chain.middleCols(1, states.cols())),
                    example.label * scorers.rows_per_word);
    background_occupancies = chain.leftCols(1) + chain.rightCols(1);
  }
  if (example.label <= words)
  {
    // The filler learns from words too: it is speech of any kind.
    const RowMatrix components = scorers.filler.components(example.features);
    const RowMatrix states = scorers.filler.states(components);
    RowMatrix occupancies;
    RowMatrix beside;
    const float filler_score = fillerScore(states, background, &occupancies, &beside);
    sums->filler.add(example.features, componentShares(components, states, occupancies));
    if (example.label == words)
    {
      score = filler_score;
      background_occupancies = beside;
    }
  }
  else
  {
    score = backgroundScore(background);
  }
  sums->background.add(example.features, componentShares(background_components, background, background_occupancies));
  sums->loss -= score;
  sums->weight += static_cast<double>(example.features.rows());
}

void checkExamples(const std::vector<std::string>& words, const std::vector<TrainingExample>& examples)
{
  std::vector<int> counts(words.size() + 2, 0);
  for (const TrainingExample& example : examples)
  {
    if (example.label < 0 || example.label >= static_cast<int>(counts.size()))
    {
      throw std::invalid_argument("an example has the label " + std::to_string(example.label) + ", must be in [0, " +
                                  std::to_string(counts.size() - 1) + "]");
    }
    if (example.features.rows() == 0)
    {
      throw std::invalid_argument("an example has no frame: leave clips out that are shorter than 25 ms");
    }
    ++counts[static_cast<size_t>(example.label)];
  }
  for (size_t i = 0; i < counts.size(); ++i)
  {
    if (counts[i] == 0)
    {
      const std::string name =
          i < words.size() ? "the word " + words[i] : (i == words.size() ? "other speech" : "the background");
      throw std::invalid_argument("there is no example of " + name + ": record some, or leave the word out");
    }
  }
}

Eigen::RowVectorXd varianceOfFrames(const std::vector<TrainingExample>& examples)
{
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(FEATURES);
  Eigen::RowVectorXd squares = Eigen::RowVectorXd::Zero(FEATURES);
  double frames = 0.0;
  for (const TrainingExample& example : examples)
  {
    sum += example.features.colwise().sum().cast<double>();
    squares += example.features.cwiseAbs2().colwise().sum().cast<double>();
    frames += static_cast<double>(example.features.rows());
  }
  return squares / frames - (sum / frames).cwiseAbs2();
}

/// To begin with, a word's states share its loud part evenly, and all else is background.
void startEvenly(const std::vector<TrainingExample>& examples, const Eigen::VectorXd& prior_variance,
                 WordModels* models)
{
  const auto word_count = static_cast<int>(models->words.size());
  AllMoments first(*models);
  for (const TrainingExample& example : examples)
  {
    const auto [from, to] = loudPart(example.features);
    RowMatrix background = RowMatrix::Ones(example.features.rows(), 1);
    RowMatrix states = RowMatrix::Zero(example.features.rows(), models->word_mixtures.states);
    if (example.label <= word_count)
    {
      background.middleRows(from, to - from).setZero();
    }
    if (example.label < word_count)
    {
      for (Eigen::Index t = from; t < to; ++t)
      {
        const Eigen::Index state = (t - from) * models->states_per_word / (to - from);
        states(t, example.label * models->states_per_word + state) = 1.0F;
      }
    }
    first.words.add(example.features, states);
    first.background.add(example.features, background);
  }
  maximise(first.words, prior_variance, &models->word_mixtures);
  maximise(first.background, prior_variance, &models->background);
}

/// Adam for one array of parameters.
class Adam
{
public:
  explicit Adam(Eigen::Index size) : first_(Eigen::ArrayXd::Zero(size)), second_(Eigen::ArrayXd::Zero(size)) {}

  /// @param step  1 for the first.
  void update(const Eigen::ArrayXd& gradient, double rate, int step, Eigen::ArrayXd* values)
  {
    first_ = BETA1 * first_ + (1.0 - BETA1) * gradient;
    second_ = BETA2 * second_ + (1.0 - BETA2) * gradient.square();
    const double correction1 = 1.0 - std::pow(BETA1, step);
    const double correction2 = 1.0 - std::pow(BETA2, step);
    *values -= rate * (first_ / correction1) / ((second_ / correction2).sqrt() + 1e-8);
  }

private:
  static constexpr double BETA1 = 0.9;
  static constexpr double BETA2 = 0.999;
  Eigen::ArrayXd first_;
  Eigen::ArrayXd second_;
};

/// Gradient steps of one set of mixtures. Means move in standard deviations.
class MixtureSteps
{
public:
  explicit MixtureSteps(DiagonalMixtures* mixtures)
    : mixtures_(mixtures)
    , means_(mixtures->means.size())
    , variances_(mixtures->log_variances.size())
    , weights_(mixtures->log_weights.size())
  {
  }

  /// @param moments  weighted with the derivative of the loss by the state's emission.
  void step(const Moments& moments, double rate, int number)
  {
    const Doubles means = mixtures_->means.cast<double>();
    const Doubles log_variances = mixtures_->log_variances.cast<double>();
    const Doubles precisions = (-log_variances.array()).exp();
    const Doubles deviations = (0.5 * log_variances.array()).exp();
    // sum of w r (x - m) / sigma, and of w r ((x - m)^2 / sigma^2 - 1) / 2
    const Doubles centred = moments.first - (means.array().colwise() * moments.count.array()).matrix();
    Doubles mean_gradient = centred.cwiseProduct(precisions).cwiseProduct(deviations);
    const Doubles squares = moments.second - 2.0 * means.cwiseProduct(moments.first) +
                            (means.array().square().colwise() * moments.count.array()).matrix();
    Doubles variance_gradient = 0.5 * squares.cwiseProduct(precisions);
    variance_gradient.colwise() -= 0.5 * moments.count;

    Eigen::ArrayXd moved = Eigen::ArrayXd::Zero(means.size());
    means_.update(Eigen::Map<const Eigen::ArrayXd>(mean_gradient.data(), mean_gradient.size()), rate, number, &moved);
    mixtures_->means +=
        Eigen::Map<const Doubles>(moved.data(), means.rows(), means.cols()).cwiseProduct(deviations).cast<float>();

    Eigen::ArrayXd variances = Eigen::Map<const Eigen::ArrayXd>(log_variances.data(), log_variances.size());
    variances_.update(Eigen::Map<const Eigen::ArrayXd>(variance_gradient.data(), variance_gradient.size()), 0.5 * rate,
                      number, &variances);
    mixtures_->log_variances = Eigen::Map<const Doubles>(variances.data(), means.rows(), means.cols()).cast<float>();

    Eigen::ArrayXd weights = mixtures_->log_weights.cast<double>();
    Eigen::ArrayXd weight_gradient(weights.size());
    for (int s = 0; s < mixtures_->states; ++s)
    {
      const Eigen::Index first = static_cast<Eigen::Index>(s) * mixtures_->components;
      const auto counts = moments.count.segment(first, mixtures_->components).array();
      weight_gradient.segment(first, mixtures_->components) =
          counts - weights.segment(first, mixtures_->components).exp() * counts.sum();
    }
    weights_.update(weight_gradient, rate, number, &weights);
    for (int s = 0; s < mixtures_->states; ++s)
    {
      auto part = weights.segment(static_cast<Eigen::Index>(s) * mixtures_->components, mixtures_->components);
      part -= std::log(part.exp().sum());
    }
    mixtures_->log_weights = weights.cast<float>();
  }

private:
  DiagonalMixtures* mixtures_;
  Adam means_;
  Adam variances_;
  Adam weights_;
};

/// Adds one utterance's part of loss and gradient.
void addGradient(const WordModels& models, const Scorers& scorers, const TrainingExample& example, double weight,
                 AllMoments* sums)
{
  const int words = static_cast<int>(models.words.size());
  const Emissions emissions = scorers(example.features);
  const auto classes = static_cast<size_t>(words) + 2;
  std::vector<RowMatrix> chains(static_cast<size_t>(words));
  RowMatrix filler;
  RowMatrix filler_background;
  Eigen::ArrayXd scores(static_cast<Eigen::Index>(classes));
  for (int w = 0; w < words; ++w)
  {
    scores[w] = chainScore(emissions.words, chainOf(w, models.states_per_word, words), &chains[static_cast<size_t>(w)]);
  }
  scores[words] = fillerScore(emissions.filler, emissions.background, &filler, &filler_background);
  scores[words + 1] = backgroundScore(emissions.background);
  if (!scores.allFinite())
  {
    return;  // too short for a word
  }
  Eigen::ArrayXd logits = models.scale * scores;
  for (int w = 0; w < words; ++w)
  {
    logits[w] += models.word_biases[static_cast<size_t>(w)];
  }
  logits[words] += models.filler_bias;
  logits[words + 1] += models.background_bias;
  const double most = logits.maxCoeff();
  const Eigen::ArrayXd log_posteriors = logits - most - std::log((logits - most).exp().sum());
  Eigen::ArrayXd wanted = Eigen::ArrayXd::Constant(logits.size(), LABEL_SMOOTHING / static_cast<double>(classes));
  wanted[example.label] += 1.0 - LABEL_SMOOTHING;
  sums->loss -= weight * (wanted * log_posteriors).sum();
  sums->weight += weight;
  const Eigen::ArrayXd slopes = weight * (log_posteriors.exp() - wanted);
  sums->biases += slopes.matrix();
  sums->scale += (slopes * scores).sum();

  Occupancies occupancies(emissions);
  for (int w = 0; w < words; ++w)
  {
    occupancies.addChain(chainOf(w, models.states_per_word, words), chains[static_cast<size_t>(w)],
                         static_cast<float>(models.scale * slopes[w]));
  }
  const auto filler_slope = static_cast<float>(models.scale * slopes[words]);
  occupancies.filler += filler_slope * filler;
  occupancies.background += filler_slope * filler_background;
  occupancies.background.array() += static_cast<float>(models.scale * slopes[words + 1]);
  sums->addOccupancies(example.features, emissions, occupancies);
}

}  // namespace

void TrainerOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("states_per_word", states_per_word, 1, 100);
  for (const auto& [name, value] : {std::pair<const char*, int>{"components", components},
                                    {"filler_components", filler_components},
                                    {"background_components", background_components}})
  {
    check.range(name, value, 1, 256);
    if ((value & (value - 1)) != 0)
    {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", must be a power of 2");
    }
  }
  check.range("filler_states", filler_states, 1, 1000);
  check.range("likelihood_passes", likelihood_passes, 1, 100);
  check.range("epochs", epochs, 0, 1000);
  check.range("rate", rate, 1e-6, 1.0);
  check.range("other_weight", other_weight, 0.01, 100.0);
  check.range("batch", batch, 1, 100000);
  check.range("threads", threads, 1, 256);
}

WordModels trainLikelihood(const std::vector<std::string>& words, const std::vector<TrainingExample>& examples,
                           const TrainerOptions& options, const TrainingProgress& progress)
{
  options.validate();
  checkExamples(words, examples);
  const int word_count = static_cast<int>(words.size());
  WordModels models;
  models.words = words;
  models.states_per_word = options.states_per_word;
  models.word_mixtures = DiagonalMixtures(word_count * options.states_per_word, 1);
  models.filler = DiagonalMixtures(options.filler_states, 1);
  models.background = DiagonalMixtures(1, 1);
  models.scale = 0.1F;
  models.word_biases.assign(words.size(), 0.0F);

  const Eigen::RowVectorXd variance = varianceOfFrames(examples);
  const Eigen::VectorXd prior_variance = 0.1 * variance.transpose();
  startEvenly(examples, prior_variance, &models);
  const Eigen::RowVectorXf deviation = variance.cwiseSqrt().cast<float>();
  models.filler.means = clusterSpeech(examples, options.filler_states, deviation, options.seed);
  models.filler.log_variances.rowwise() = (0.5 * variance).array().log().matrix().cast<float>();

  int pass = 0;
  const auto expectMaximise = [&]
  {
    std::vector<AllMoments> sums(static_cast<size_t>(options.threads), AllMoments(models));
    const LikelihoodScorers scorers(models);
    inParallel(options.threads, examples.size(),
               [&](size_t worker, size_t begin, size_t end)
               {
                 for (size_t i = begin; i < end; ++i)
                 {
                   addOccupancies(scorers, examples[i], &sums[worker]);
                 }
               });
    for (size_t i = 1; i < sums.size(); ++i)
    {
      sums[0].add(sums[i]);
    }
    maximise(sums[0].words, prior_variance, &models.word_mixtures);
    maximise(sums[0].filler, prior_variance, &models.filler);
    maximise(sums[0].background, prior_variance, &models.background);
    progress("likelihood", ++pass, sums[0].loss / sums[0].weight);
  };

  const int most = std::max({options.components, options.filler_components, options.background_components});
  for (int components = 1; components <= most; components *= 2)
  {
    for (const auto& [mixtures, wanted] : {std::pair<DiagonalMixtures*, int>{&models.word_mixtures, options.components},
                                           {&models.filler, options.filler_components},
                                           {&models.background, options.background_components}})
    {
      if (components > 1 && components <= wanted)
      {
        split(mixtures);
      }
    }
    for (int i = 0; i < options.likelihood_passes; ++i)
    {
      expectMaximise();
    }
  }
  return models;
}

void trainPosterior(WordModels* models, const std::vector<TrainingExample>& examples, const TrainerOptions& options,
                    const TrainingProgress& progress)
{
  options.validate();
  checkExamples(models->words, examples);
  const int words = static_cast<int>(models->words.size());
  MixtureSteps word_steps(&models->word_mixtures);
  MixtureSteps filler_steps(&models->filler);
  MixtureSteps background_steps(&models->background);
  Adam scale_steps(1);
  Adam bias_steps(words + 2);
  std::mt19937 random(options.seed);
  std::vector<size_t> order(examples.size());
  std::iota(order.begin(), order.end(), 0);
  const size_t batch = static_cast<size_t>(options.batch);
  const size_t batches = (examples.size() + batch - 1) / batch;
  const auto steps = static_cast<double>(batches) * options.epochs;
  int number = 0;
  for (int epoch = 1; epoch <= options.epochs; ++epoch)
  {
    std::shuffle(order.begin(), order.end(), random);
    double loss = 0.0;
    double weight = 0.0;
    for (size_t b = 0; b < batches; ++b)
    {
      const size_t first = b * batch;
      const size_t count = std::min(batch, order.size() - first);
      const Scorers scorers(*models);
      std::vector<AllMoments> sums(static_cast<size_t>(options.threads), AllMoments(*models));
      inParallel(options.threads, count,
                 [&](size_t worker, size_t begin, size_t end)
                 {
                   for (size_t i = begin; i < end; ++i)
                   {
                     const TrainingExample& example = examples[order[first + i]];
                     addGradient(*models, scorers, example, example.label == words ? options.other_weight : 1.0,
                                 &sums[worker]);
                   }
                 });
      for (size_t i = 1; i < sums.size(); ++i)
      {
        sums[0].add(sums[i]);
      }
      AllMoments& sum = sums[0];
      loss += sum.loss;
      weight += sum.weight;
      ++number;
      // One cycle: up over a tenth of the steps, down by a cosine.
      const double part = number / steps;
      const double rate = options.rate * (part < 0.1 ? part / 0.1 : 0.5 * (1.0 + std::cos(M_PI * (part - 0.1) / 0.9)));
      const double norm = 1.0 / std::max(1.0, sum.weight);
      for (Moments* moments : {&sum.words, &sum.filler, &sum.background})
      {
        moments->first *= norm;
        moments->second *= norm;
        moments->count *= norm;
      }
      word_steps.step(sum.words, rate, number);
      filler_steps.step(sum.filler, rate, number);
      background_steps.step(sum.background, rate, number);
      Eigen::ArrayXd scale = Eigen::ArrayXd::Constant(1, std::log(models->scale));
      scale_steps.update(Eigen::ArrayXd::Constant(1, models->scale * sum.scale * norm), rate, number, &scale);
      models->scale = static_cast<float>(std::exp(scale[0]));
      Eigen::ArrayXd biases(words + 2);
      for (int w = 0; w < words; ++w)
      {
        biases[w] = models->word_biases[static_cast<size_t>(w)];
      }
      biases[words] = models->filler_bias;
      biases[words + 1] = models->background_bias;
      bias_steps.update(sum.biases.array() * norm, 3.0 * rate, number, &biases);
      for (int w = 0; w < words; ++w)
      {
        models->word_biases[static_cast<size_t>(w)] = static_cast<float>(biases[w]);
      }
      models->filler_bias = static_cast<float>(biases[words]);
      models->background_bias = static_cast<float>(biases[words + 1]);
    }
    progress("posterior", epoch, loss / weight);
  }
}

std::vector<float> classPosteriors(const WordScorer::Scores& scores)
{
  std::vector<float> logits = scores.sequences;
  logits.push_back(scores.filler);
  logits.push_back(scores.background);
  const float most = *std::max_element(logits.begin(), logits.end());
  float sum = 0.0F;
  for (float& logit : logits)
  {
    logit = std::exp(logit - most);
    sum += logit;
  }
  for (float& logit : logits)
  {
    logit /= sum;
  }
  return logits;
}

}  // namespace pi_speech
