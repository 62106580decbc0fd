// train_word_models: models of whole words from clips with one word each. See training/README.md.

#include <pi_node/command_line.h>
#include <pi_node/stop_signal.h>
#include <pi_speech/audio.h>
#include <pi_speech/end_pointer.h>
#include "clips/noisy_clips.h"
#include "features/speech_features.h"
#include "hmm/word_models.h"

#include <algorithm>
#include <boost/crc.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "word_models/word_model_trainer.h"

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using pi_speech::Samples;

constexpr char BACKGROUND[] = "_silence_";
constexpr double COPY_SPEED_SHARE = 0.7;  ///< of the copies that are faster or slower
constexpr double MOST_SPEED = 0.12;
constexpr double COPY_NOISE_SHARE = 0.7;  ///< of the copies with noise
constexpr double LEAST_SNR_DB = 5.0;
constexpr double MOST_SNR_DB = 25.0;
constexpr size_t MOST_FRAMES = 220;

struct Arguments
{
  std::string clips;
  std::vector<std::string> words;
  std::string output;
  std::vector<std::string> noises;
  int copies = 4;
  int folds = 5;
  int left_out = -1;
  pi_speech::TrainerOptions trainer;
};

struct Clip
{
  std::string path;
  std::string word;
  std::string speaker;
};

/// Of a list with the columns file, word and speaker; files are beside it.
std::vector<Clip> readList(const std::string& path)
{
  std::ifstream stream(path);
  if (!stream)
  {
    throw std::runtime_error(path + ": the list of clips cannot be read: does the file exist?");
  }
  std::vector<Clip> clips;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number)
  {
    std::istringstream columns(line);
    Clip clip;
    if (!std::getline(columns, clip.path, '\t') || !std::getline(columns, clip.word, '\t') ||
        !std::getline(columns, clip.speaker, '\t'))
    {
      throw std::runtime_error(path + ":" + std::to_string(number) +
                               ": must have the columns file, word and speaker, with tabs between");
    }
    if (number > 1 || clip.path != "file")
    {
      clip.path = (fs::path(path).parent_path() / clip.path).string();
      clips.push_back(clip);
    }
  }
  return clips;
}

/// Python's zlib.crc32() is the same: folds are equal everywhere.
uint32_t crc32(const std::string& text)
{
  boost::crc_32_type sum;
  sum.process_bytes(text.data(), text.size());
  return sum.checksum();
}

/// The longest utterance of a clip, as the recogniser cuts it.
std::optional<Samples> utteranceOf(const Samples& clip)
{
  std::optional<pi_speech::Utterance> longest;
  pi_speech::EndPointer end_pointer(
      pi_speech::EndPointerOptions(),
      [&longest](pi_speech::EndPointer::Event event, const pi_speech::Utterance& utterance)
      {
        if (event == pi_speech::EndPointer::Event::END &&
            (!longest || utterance.speech_end - utterance.speech_begin > longest->speech_end - longest->speech_begin))
        {
          longest = utterance;
        }
      });
  end_pointer.process(clip.data(), clip.size());
  end_pointer.flush();
  if (!longest)
  {
    return std::nullopt;
  }
  return longest->samples;
}

Samples changeSpeed(const Samples& clip, double factor)
{
  pi_speech::AudioFormat format;
  format.sample_rate_hz = static_cast<int>(std::lround(factor * pi_speech::SAMPLE_RATE_HZ));
  pi_speech::Resampler resampler(format);
  Samples result;
  resampler.process(clip.data(), clip.size(), &result);
  resampler.flush(&result);
  return result;
}

/// Clips as examples, with copies at other speeds and in noise.
class Examples
{
public:
  Examples(std::vector<std::string> words, std::vector<std::string> noises, uint32_t seed)
    : words_(std::move(words)), random_(seed)
  {
    noises.insert(noises.begin(), {"white", "pink"});
    for (const std::string& noise : noises)
    {
      noises_.emplace_back(noise, seed);
    }
  }

  void add(const Clip& clip, int copies)
  {
    const auto word = std::find(words_.begin(), words_.end(), clip.word);
    const bool is_background = clip.word == BACKGROUND;
    const int label = is_background ? static_cast<int>(words_.size()) + 1 : static_cast<int>(word - words_.begin());
    const Samples samples = pi_speech::readAudioFile(clip.path);
    addExample(utteranceOf(samples).value_or(samples), label);
    for (int copy = 0; copy < copies; ++copy)
    {
      Samples changed = samples;
      if (chance(COPY_SPEED_SHARE))
      {
        changed = changeSpeed(changed, 1.0 + uniform(-MOST_SPEED, MOST_SPEED));
      }
      if (chance(COPY_NOISE_SHARE) && !is_background)
      {
        pi_speech::NoiseSource& noise = noises_[std::uniform_int_distribution<size_t>(0, noises_.size() - 1)(random_)];
        changed = pi_speech::mixNoise(changed, noise.next(changed.size()), uniform(LEAST_SNR_DB, MOST_SNR_DB));
      }
      if (const auto utterance = utteranceOf(changed))
      {
        addExample(*utterance, label);
      }
    }
  }

  const std::vector<pi_speech::TrainingExample>& all() const { return examples_; }

private:
  void addExample(const Samples& samples, int label)
  {
    pi_speech::TrainingExample example;
    const size_t most = pi_speech::FRAME_SAMPLES + (MOST_FRAMES - 1) * pi_speech::HOP_SAMPLES;
    example.features = features_.compute(samples.data(), std::min(samples.size(), most));
    example.label = label;
    if (example.features.rows() > 0)
    {
      examples_.push_back(std::move(example));
    }
  }

  double uniform(double least, double most) { return std::uniform_real_distribution<double>(least, most)(random_); }
  bool chance(double share) { return uniform(0.0, 1.0) < share; }

  const std::vector<std::string> words_;
  std::mt19937 random_;
  std::vector<pi_speech::NoiseSource> noises_;
  pi_speech::SpeechFeatures features_;
  std::vector<pi_speech::TrainingExample> examples_;
};

bool parse(int argc, char** argv, Arguments* line)
{
  pi_speech::TrainerOptions& trainer = line->trainer;
  trainer.components = 8;
  trainer.filler_components = 8;
  trainer.background_components = 16;
  trainer.epochs = 0;
  pi_node::CommandLine options(
      "train_word_models --clips LIST.tsv --words WORD... --output FILE\n"
      "Trains hidden Markov models of whole words. The list has the columns file, word and speaker; other words stand\n"
      "for other speech, _silence_ for background");
  options.add("clips", po::value(&line->clips)->required(), "list of clips");
  options.add("words", po::value(&line->words)->multitoken()->required(), "words that get a model");
  options.add("output", po::value(&line->output)->required(), "file of the models");
  options.addValue("copies", &line->copies, "of each clip, at other speeds and in noise");
  options.add("noise", po::value(&line->noises)->multitoken(), "sound files of noise, besides white and pink");
  options.addValue("folds", &line->folds, "parts of the speakers, by the CRC-32 of their names");
  options.addValue("leave-out", &line->left_out, "part whose speakers are left out, for cross-validation");
  options.addValue("states", &trainer.states_per_word, "of a word");
  options.addValue("components", &trainer.components, "Gaussians of a state");
  options.addValue("posterior-epochs", &trainer.epochs, "of training for the posterior after that for the likelihood");
  options.addValue("rate", &trainer.rate, "of that training");
  options.addValue("threads", &trainer.threads, "that work");
  options.addValue("seed", &trainer.seed, "of copies and clusters");
  if (!options.parse(argc, argv))
  {
    return false;
  }
  if (line->folds < 2 || line->left_out >= line->folds)
  {
    throw std::invalid_argument("leave-out = " + std::to_string(line->left_out) + ", must be below folds = " +
                                std::to_string(line->folds) + ", which must be at least 2");
  }
  return true;
}

int run(const Arguments& line)
{
  Examples examples(line.words, line.noises, line.trainer.seed);
  for (const Clip& clip : readList(line.clips))
  {
    if (pi_node::StopSignal::came())
    {
      return pi_node::StopSignal::exitStatus();
    }
    if (line.left_out < 0 || static_cast<int>(crc32(clip.speaker) % static_cast<uint32_t>(line.folds)) != line.left_out)
    {
      examples.add(clip, line.copies);
    }
  }
  std::cerr << examples.all().size() << " examples\n";
  const auto progress = [](const std::string& stage, int pass, double loss)
  {
    std::cerr << stage << " " << pass << ": " << loss << "\n";
    if (pi_node::StopSignal::came())
    {
      throw std::runtime_error("stopped");
    }
  };
  pi_speech::WordModels models = pi_speech::trainLikelihood(line.words, examples.all(), line.trainer, progress);
  if (line.trainer.epochs > 0)
  {
    pi_speech::trainPosterior(&models, examples.all(), line.trainer, progress);
  }
  models.save(line.output);
  return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments line;
  return pi_node::runTool(
      "train_word_models", [&] { return parse(argc, argv, &line); },
      [&]
      {
        pi_node::StopSignal::install();
        return run(line);
      });
}
