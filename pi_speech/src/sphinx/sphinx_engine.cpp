#include "sphinx/sphinx_engine.h"

#include <pocketsphinx.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <utility>

#include "sphinx/model_definition.h"
#include "sphinx/sphinx_log.h"
#include "recognizer/words.h"

namespace pi_speech
{
namespace
{

namespace fs = std::filesystem;

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

std::string nameOf(size_t grammar)
{
  return "grammar_" + std::to_string(grammar);
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

NamedScores::Link::Link(const NamedScores& scores, int utterance)
{
  char name[32];
  std::snprintf(name, sizeof name, "/%09d.sen", utterance);
  path_ = scores.folder() + name;
  std::error_code error;
  fs::create_symlink(scores.target_, path_, error);
  if (error)
  {
    throw std::runtime_error(path_ + ": this link to the scores of an utterance cannot be made: " + error.message() +
                             "; make room there");
  }
}

NamedScores::Link::~Link()
{
  std::error_code ignored;
  fs::remove(path_, ignored);
}

SphinxEngine::SphinxEngine(const SphinxModel& model, const std::string& dictionary,
                           const std::vector<std::string>& grammars)
  : model_(model), grammars_(grammars.size()), scores_(""), named_scores_(scores_)
{
  quietSphinx();
  clearSphinxErrors();
  checkSphinxFiles(model, grammars.empty());
  fillers_ = readFillers(model.acoustic_model);
  scorer_ = load(dictionary, true);
  if (grammars.empty())
  {
    if (ps_set_lm_file(scorer_.decoder.get(), nameOf(0).c_str(), model.language_model.c_str()) != 0)
    {
      throw std::runtime_error(model.language_model + ": PocketSphinx cannot load this language model: " +
                               sphinxErrors() + "; install pocketsphinx-en-us, or give another one");
    }
    return;
  }
  loadGrammar(&scorer_, 0, grammars.front());
  searcher_ = load(dictionary, false);
  for (size_t i = 0; i < grammars.size(); ++i)
  {
    loadGrammar(&searcher_, i, grammars[i]);
  }
  if (ps_set_allphone(searcher_.decoder.get(), PHONES, nullptr) != 0)
  {
    throw std::runtime_error(model_.acoustic_model + ": PocketSphinx makes no loop of the phones of this acoustic " +
                             "model: " + sphinxErrors() + WAY_OUT);
  }
}

SphinxEngine::~SphinxEngine() = default;

SphinxEngine::Decoder SphinxEngine::load(const std::string& dictionary, bool scores) const
{
  const MemoryFile words(dictionary);
  Decoder result;
  result.config.reset(cmd_ln_init(nullptr, ps_args(), 1, "-hmm", model_.acoustic_model.c_str(), nullptr));
  cmd_ln_s* const config = result.config.get();
  cmd_ln_set_str_r(config, "-dict", grammars_ == 0 ? model_.dictionary.c_str() : words.path().c_str());
  if (!model_.adaptation.empty())
  {
    cmd_ln_set_str_r(config, "-mean", (model_.adaptation + "/means").c_str());
    cmd_ln_set_str_r(config, "-sendump", (model_.adaptation + "/sendump").c_str());
  }
  if (grammars_ != 0 && scores)
  {
    cmd_ln_set_boolean_r(config, "-compallsen", 1);
    cmd_ln_set_str_r(config, "-senlogdir", named_scores_.folder().c_str());
  }
  if (!scores)
  {
    // Frames are read in order; with a window of frames to look ahead PocketSphinx would go back to wrong places.
    cmd_ln_set_int_r(config, "-pl_window", 0);
  }
  // One frame is 10 ms of the sound, whatever is silent: costs no command (1291 of 1496 instead of 1293).
  cmd_ln_set_boolean_r(config, "-remove_silence", 0);
  // All phones, whatever stands beside them, would take 2.5 s per second of sound.
  cmd_ln_set_boolean_r(config, "-allphone_ci", 1);
  // Read instead of mapped: PocketSphinx sees then that a file is too short, and the file may be replaced meanwhile.
  cmd_ln_set_boolean_r(config, "-mmap", 0);
  result.decoder.reset(ps_init(config));
  if (result.decoder == nullptr || !sphinxErrors().empty())
  {
    throw std::runtime_error(model_.acoustic_model +
                             ": PocketSphinx cannot load this acoustic model, or not with this " +
                             "dictionary: " + sphinxErrors() + WAY_OUT);
  }
  const auto rate = static_cast<int>(std::lround(cmd_ln_float32_r(config, "-samprate")));
  if (rate != SAMPLE_RATE_HZ || cmd_ln_int32_r(config, "-frate") != FRAMES_PER_S)
  {
    throw std::runtime_error(model_.acoustic_model + ": the acoustic model is for " + std::to_string(rate) +
                             " Hz and " + std::to_string(cmd_ln_int32_r(config, "-frate")) +
                             " frames per second, must be for 16000 Hz and 100" + WAY_OUT);
  }
  clearSphinxErrors();
  return result;
}

void SphinxEngine::loadGrammar(Decoder* decoder, size_t number, const std::string& jsgf) const
{
  if (jsgf.compare(0, 5, "#JSGF") != 0)
  {
    throw std::runtime_error("the grammar does not begin with \"#JSGF V1.0;\"; write it in the format JSGF");
  }
  if (ps_set_jsgf_string(decoder->decoder.get(), nameOf(number).c_str(), jsgf.c_str()) != 0)
  {
    throw std::runtime_error("the grammar cannot be used with the acoustic model " + model_.acoustic_model + ": " +
                             sphinxErrors() + "; give the words that it names, in phones of this model");
  }
}

int SphinxEngine::process(const int16_t* samples, size_t count)
{
  ps_decoder_s* const decoder = scorer_.decoder.get();
  clearSphinxErrors();
  // What is known of the noise is forgotten: the same sound has the same result, whatever was before.
  if (ps_set_search(decoder, nameOf(0).c_str()) != 0 || ps_start_stream(decoder) != 0)
  {
    throw std::runtime_error("PocketSphinx begins no utterance: " + sphinxErrors());
  }
  const int number = utterances_++;
  std::optional<NamedScores::Link> link;
  if (grammars_ != 0)
  {
    link.emplace(named_scores_, number);
  }
  if (ps_start_utt(decoder) != 0)
  {
    throw std::runtime_error("PocketSphinx begins no utterance: " + sphinxErrors());
  }
  const int frames = ps_process_raw(decoder, samples, count, 0, 1);
  if (ps_end_utt(decoder) != 0 || frames < 0)
  {
    throw std::runtime_error("PocketSphinx cannot decode " + std::to_string(count) + " samples: " + sphinxErrors());
  }
  return frames;
}

void SphinxEngine::listen(const int16_t* samples, size_t count)
{
  frames_ = 0;
  frames_ = fits(count) ? process(samples, count) : 0;
}

SphinxHypothesis SphinxEngine::find(size_t grammar)
{
  if (grammar >= grammars_)
  {
    throw std::out_of_range("grammar " + std::to_string(grammar) + " of " + std::to_string(grammars_));
  }
  return search(nameOf(grammar));
}

SphinxHypothesis SphinxEngine::findPhones()
{
  return search(PHONES);
}

SphinxHypothesis SphinxEngine::search(const std::string& name)
{
  if (frames_ == 0)
  {
    return {};
  }
  const std::unique_ptr<FILE, int (*)(FILE*)> file(std::fopen(scores_.path().c_str(), "rb"), std::fclose);
  clearSphinxErrors();
  if (file == nullptr || ps_set_search(searcher_.decoder.get(), name.c_str()) != 0)
  {
    throw std::runtime_error("PocketSphinx begins no search: " + (file ? sphinxErrors() : std::strerror(errno)));
  }
  const int frames = ps_decode_senscr(searcher_.decoder.get(), file.get());
  if (frames != frames_)
  {
    throw std::runtime_error("PocketSphinx has scores of " + std::to_string(std::max(frames, 0)) + " of " +
                             std::to_string(frames_) + " frames: is the memory full?");
  }
  return hypothesisOf(searcher_.decoder.get(), frames);
}

SphinxHypothesis SphinxEngine::decode(const int16_t* samples, size_t count)
{
  if (grammars_ == 0)
  {
    const int frames = fits(count) ? process(samples, count) : 0;
    return frames == 0 ? SphinxHypothesis() : hypothesisOf(scorer_.decoder.get(), frames);
  }
  listen(samples, count);
  return find(0);
}

SphinxHypothesis SphinxEngine::hypothesisOf(ps_decoder_s* decoder, int frames) const
{
  const double unit = SCORE_UNIT * std::log(logmath_get_base(ps_get_logmath(decoder)));
  SphinxHypothesis hypothesis;
  hypothesis.frames = frames;
  double score = 0.0;
  bool found = false;
  for (ps_seg_t* segment = ps_seg_iter(decoder); segment != nullptr; segment = ps_seg_next(segment))
  {
    int32 acoustic = 0;
    ps_seg_prob(segment, &acoustic, nullptr, nullptr);
    score += unit * acoustic;
    found = true;
    SphinxHypothesis::Word word{ps_seg_word(segment), 0, 0, unit * acoustic};
    ps_seg_frames(segment, &word.first_frame, &word.last_frame);
    const size_t number = word.text.find('(', 1);
    if (fillers_.count(word.text) == 0)
    {
      word.text.erase(std::min(number, word.text.size()));
      hypothesis.words.push_back(std::move(word));
    }
  }
  if (found)
  {
    hypothesis.score = score;
  }
  return hypothesis;
}

}  // namespace pi_speech
