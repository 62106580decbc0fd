#include <pi_speech/sphinx_decoder.h>
#include "recognizer/pronunciation.h"
#include "sphinx/speech_model_check.h"

#include <filesystem>

#include "sphinx/sphinx_engine.h"

namespace pi_speech
{
namespace
{

/// Of the grammar's words only: the whole dictionary would take 23 MB and 130 ms.
std::string dictionaryOf(const SphinxModel& model, const std::vector<std::string>& words,
                         std::vector<std::string>* guesses)
{
  const std::filesystem::path additions = std::filesystem::path(model.adaptation) / "pronunciations.dict";
  std::error_code error;
  const bool has_additions = !model.adaptation.empty() && std::filesystem::exists(additions, error);
  Pronunciation pronunciation(model.dictionary, model.guess_words, has_additions ? additions.string() : "");
  std::string dictionary = pronunciation.dictionaryOf(words);
  *guesses = pronunciation.guesses();
  return dictionary;
}

}  // namespace

std::string SphinxHypothesis::text() const
{
  std::string result;
  for (const Word& word : words)
  {
    result += (result.empty() ? "" : " ") + word.text;
  }
  return result;
}

SphinxDecoder::SphinxDecoder(const SphinxModel& model, const std::vector<std::string>& grammars,
                             const std::vector<std::string>& words)
{
  const std::string dictionary = grammars.empty() ? std::string() : dictionaryOf(model, words, &guesses_);
  if (model.check_model)
  {
    // One grammar is enough to find out whether the model is good.
    checkSpeechModel(model, dictionary, grammars.empty() ? std::string() : grammars.front());
  }
  engine_ = std::make_unique<SphinxEngine>(model, dictionary, grammars);
}

SphinxDecoder::~SphinxDecoder() = default;

void SphinxDecoder::listen(const int16_t* samples, size_t count)
{
  engine_->listen(samples, count);
}

SphinxHypothesis SphinxDecoder::find(size_t grammar)
{
  return engine_->find(grammar);
}

SphinxHypothesis SphinxDecoder::findPhones()
{
  return engine_->findPhones();
}

SphinxHypothesis SphinxDecoder::decode(const int16_t* samples, size_t count)
{
  return engine_->decode(samples, count);
}

}  // namespace pi_speech
