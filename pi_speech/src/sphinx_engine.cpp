#include "sphinx_engine.h"

#include <pocketsphinx.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <utility>

#include "memory_file.h"
#include "model_definition.h"
#include "sphinx_log.h"
#include "words.h"

namespace pi_speech
{
namespace
{

namespace fs = std::filesystem;

constexpr char WORDS[] = "words";
constexpr char PHONES[] = "phones";
constexpr int FRAMES_PER_S = 100;
/// PocketSphinx gives out its first frame when it has ten; shorter sound has no word in it.
constexpr size_t LEAST_SAMPLES = SAMPLE_RATE_HZ * 12 / 100;
/// PocketSphinx ends the process at 32767 frames.
constexpr size_t MOST_SAMPLES = size_t{300} * SAMPLE_RATE_HZ;
/// Scores of frames are kept by PocketSphinx as logarithms shifted right by so many bits.
constexpr double SCORE_UNIT = 1024.0;

const std::string WAY_OUT = "; install pocketsphinx-en-us, or give the folder of another model";
constexpr char ADAPTATION_WAY_OUT[] = "; train it again, or leave the adaptation out";

void checkFile(const fs::path& path, const std::string& what, const std::string& way_out)
{
  std::error_code error;
  const bool is_file = fs::is_regular_file(path, error);
  if (!is_file || !std::ifstream(path).is_open())
  {
    throw std::runtime_error(path.string() + ": " + what + (is_file ? " cannot be read" : " is missing") + way_out);
  }
  if (fs::file_size(path, error) == 0 || error)
  {
    throw std::runtime_error(path.string() + ": " + what + " is empty" + way_out);
  }
}

/// The words of the noise dictionary, and those that PocketSphinx adds.
std::set<std::string> readFillers(const std::string& folder)
{
  std::set<std::string> fillers = {"<s>", "</s>", "<sil>", "(NULL)"};
  std::ifstream file(folder + "/noisedict");
  for (std::string line; std::getline(file, line);)
  {
    const std::vector<std::string> words = splitWords(line);
    if (!words.empty())
    {
      fillers.insert(words.front());
    }
  }
  return fillers;
}

bool isParameterName(const std::string& word)
{
  const auto belongs = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; };
  return word.size() > 1 && word[0] == '-' && std::all_of(word.begin() + 1, word.end(), belongs);
}

/// PocketSphinx takes what it understands of this file and leaves out the rest, without a word.
void checkFeatureParameters(const fs::path& path)
{
  std::ifstream file(path);
  std::set<std::string> names;
  for (std::string name; file >> name;)
  {
    std::string value;
    if (!isParameterName(name) || !(file >> value))
    {
      throw std::runtime_error(path.string() + ": not a list of \"-name value\": the file is damaged" + WAY_OUT);
    }
    names.insert(name);
  }
  for (const char* name : {"-feat", "-cmn"})
  {
    if (names.count(name) == 0)
    {
      throw std::runtime_error(path.string() + ": there is no " + name + ": the file is damaged" + WAY_OUT);
    }
  }
}

/// @return false if an utterance is too short to decode. @throws std::invalid_argument if it is too long.
bool fits(size_t count)
{
  if (count > MOST_SAMPLES)
  {
    throw std::invalid_argument("an utterance of " + std::to_string(count / SAMPLE_RATE_HZ) +
                                " s, must be at most 300 s; cut it");
  }
  return count >= LEAST_SAMPLES;
}

}  // namespace

void checkSphinxFiles(const SphinxModel& model, bool dictation)
{
  const fs::path folder = model.acoustic_model;
  std::error_code error;
  if (!fs::is_directory(folder, error))
  {
    throw std::runtime_error(model.acoustic_model + ": there is no such folder of an acoustic model" + WAY_OUT);
  }
  for (const char* name : {"mdef", "means", "variances", "transition_matrices", "feat.params"})
  {
    checkFile(folder / name, "this part of the acoustic model", WAY_OUT);
  }
  const std::string problem = problemOfModelDefinition((folder / "mdef").string());
  if (!problem.empty())
  {
    throw std::runtime_error((folder / "mdef").string() + ": this part of the acoustic model is damaged: " + problem +
                             WAY_OUT);
  }
  checkFeatureParameters(folder / "feat.params");
  if (!model.adaptation.empty())
  {
    checkFile(fs::path(model.adaptation) / "means", "this part of the adaptation", ADAPTATION_WAY_OUT);
    checkFile(fs::path(model.adaptation) / "sendump", "this part of the adaptation", ADAPTATION_WAY_OUT);
  }
  const bool weights = fs::exists(folder / "mixture_weights", error);
  checkFile(folder / (weights ? "mixture_weights" : "sendump"), "this part of the acoustic model", WAY_OUT);
  if (dictation)
  {
    checkFile(model.dictionary, "the dictionary", "; install pocketsphinx-en-us, or give another one");
    checkFile(model.language_model, "the language model", "; install pocketsphinx-en-us, or give another one");
  }
}

void SphinxEngine::Free::operator()(cmd_ln_s* config) const
{
  cmd_ln_free_r(config);
}

void SphinxEngine::Free::operator()(ps_decoder_s* decoder) const
{
  ps_free(decoder);
}

SphinxEngine::SphinxEngine(const SphinxModel& model, const std::string& dictionary, const std::string& jsgf)
  : model_(model)
{
  quietSphinx();
  clearSphinxErrors();
  checkSphinxFiles(model, jsgf.empty());
  const MemoryFile words(dictionary);
  config_.reset(cmd_ln_init(nullptr, ps_args(), 1, "-hmm", model.acoustic_model.c_str(), nullptr));
  cmd_ln_set_str_r(config_.get(), "-dict", jsgf.empty() ? model.dictionary.c_str() : words.path().c_str());
  if (!model.adaptation.empty())
  {
    cmd_ln_set_str_r(config_.get(), "-mean", (model.adaptation + "/means").c_str());
    cmd_ln_set_str_r(config_.get(), "-sendump", (model.adaptation + "/sendump").c_str());
  }
  // One frame is 10 ms of the sound, whatever is silent: costs no command (1291 of 1496 instead of 1293).
  cmd_ln_set_boolean_r(config_.get(), "-remove_silence", 0);
  // All phones, whatever stands beside them, would take 2.5 s per second of sound.
  cmd_ln_set_boolean_r(config_.get(), "-allphone_ci", 1);
  // Read instead of mapped: PocketSphinx sees then that a file is too short, and the file may be replaced meanwhile.
  cmd_ln_set_boolean_r(config_.get(), "-mmap", 0);
  decoder_.reset(ps_init(config_.get()));
  if (decoder_ == nullptr || !sphinxErrors().empty())
  {
    throw std::runtime_error(model.acoustic_model +
                             ": PocketSphinx cannot load this acoustic model, or not with this " +
                             "dictionary: " + sphinxErrors() + WAY_OUT);
  }
  const auto rate = static_cast<int>(std::lround(cmd_ln_float32_r(config_.get(), "-samprate")));
  if (rate != SAMPLE_RATE_HZ || cmd_ln_int32_r(config_.get(), "-frate") != FRAMES_PER_S)
  {
    throw std::runtime_error(model.acoustic_model + ": the acoustic model is for " + std::to_string(rate) + " Hz and " +
                             std::to_string(cmd_ln_int32_r(config_.get(), "-frate")) +
                             " frames per second, must be for 16000 Hz and 100" + WAY_OUT);
  }
  fillers_ = readFillers(model.acoustic_model);
  clearSphinxErrors();
  if (jsgf.empty())
  {
    if (ps_set_lm_file(decoder_.get(), WORDS, model.language_model.c_str()) != 0)
    {
      throw std::runtime_error(model.language_model + ": PocketSphinx cannot load this language model: " +
                               sphinxErrors() + "; install pocketsphinx-en-us, or give another one");
    }
  }
  else
  {
    loadGrammar(jsgf);
  }
  loadPhoneLoop();
}

SphinxEngine::~SphinxEngine() = default;

void SphinxEngine::loadGrammar(const std::string& jsgf)
{
  if (jsgf.compare(0, 5, "#JSGF") != 0)
  {
    throw std::runtime_error("the grammar does not begin with \"#JSGF V1.0;\"; write it in the format JSGF");
  }
  if (ps_set_jsgf_string(decoder_.get(), WORDS, jsgf.c_str()) != 0)
  {
    throw std::runtime_error("the grammar cannot be used with the acoustic model " + model_.acoustic_model + ": " +
                             sphinxErrors() + "; give the words that it names, in phones of this model");
  }
}

void SphinxEngine::loadPhoneLoop()
{
  if (ps_set_allphone(decoder_.get(), PHONES, nullptr) != 0)
  {
    throw std::runtime_error(model_.acoustic_model + ": PocketSphinx makes no loop of the phones of this acoustic " +
                             "model: " + sphinxErrors() + WAY_OUT);
  }
}

int SphinxEngine::process(const char* search, const int16_t* samples, size_t count)
{
  clearSphinxErrors();
  // What is known of the noise is forgotten: the same sound has the same result, whatever was before.
  if (ps_set_search(decoder_.get(), search) != 0 || ps_start_stream(decoder_.get()) != 0 ||
      ps_start_utt(decoder_.get()) != 0)
  {
    throw std::runtime_error("PocketSphinx begins no utterance: " + sphinxErrors());
  }
  const int frames = ps_process_raw(decoder_.get(), samples, count, 0, 1);
  if (ps_end_utt(decoder_.get()) != 0 || frames < 0)
  {
    throw std::runtime_error("PocketSphinx cannot decode " + std::to_string(count) + " samples: " + sphinxErrors());
  }
  return frames;
}

double SphinxEngine::toLogLikelihood(double score, int frames) const
{
  return frames > 0 ? score * SCORE_UNIT * std::log(logmath_get_base(ps_get_logmath(decoder_.get()))) / frames : 0.0;
}

SphinxHypothesis SphinxEngine::decode(const int16_t* samples, size_t count)
{
  SphinxHypothesis hypothesis;
  if (!fits(count))
  {
    return hypothesis;
  }
  hypothesis.frames = process(WORDS, samples, count);
  double score = 0.0;
  for (ps_seg_t* segment = ps_seg_iter(decoder_.get()); segment != nullptr; segment = ps_seg_next(segment))
  {
    int32 acoustic = 0;
    ps_seg_prob(segment, &acoustic, nullptr, nullptr);
    score += acoustic;
    SphinxHypothesis::Word word{ps_seg_word(segment), 0, 0, toLogLikelihood(acoustic, 1)};
    ps_seg_frames(segment, &word.first_frame, &word.last_frame);
    const size_t number = word.text.find('(', 1);
    if (fillers_.count(word.text) == 0)
    {
      word.text.erase(std::min(number, word.text.size()));
      hypothesis.words.push_back(std::move(word));
    }
  }
  hypothesis.score = toLogLikelihood(score, hypothesis.frames);
  return hypothesis;
}

double SphinxEngine::phoneLoopScore(const int16_t* samples, size_t count, int first_frame, int last_frame)
{
  if (!fits(count))
  {
    return 0.0;
  }
  const int end = process(PHONES, samples, count);
  const int first = std::max(first_frame, 0);
  const int last = last_frame < 0 ? end : last_frame;
  double score = 0.0;
  int frames = 0;
  for (ps_seg_t* segment = ps_seg_iter(decoder_.get()); segment != nullptr; segment = ps_seg_next(segment))
  {
    int32 acoustic = 0;
    int first_of_phone = 0;
    int last_of_phone = 0;
    ps_seg_prob(segment, &acoustic, nullptr, nullptr);
    ps_seg_frames(segment, &first_of_phone, &last_of_phone);
    const int inside = std::min(last, last_of_phone) - std::max(first, first_of_phone) + 1;
    if (inside > 0)
    {
      score += static_cast<double>(acoustic) * inside / (last_of_phone - first_of_phone + 1);
      frames += inside;
    }
  }
  return toLogLikelihood(score, frames);
}

}  // namespace pi_speech
