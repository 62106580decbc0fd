#include "recognizer/pronunciation.h"
#include "sphinx/speech_model_check.h"
#include <pi_speech/sphinx_decoder.h>

#include <filesystem>

#include "sphinx/sphinx_engine.h"

namespace pi_speech
{
namespace
{

/// Of the grammar's words only: the whole dictionary would take 23 MB and 130 ms.
std::string dictionaryOf(const SphinxModel& model, const std::vector<std::string>& words)
{
  const std::filesystem::path additions = std::filesystem::path(model.adaptation) / "pronunciations.dict";
  std::error_code error;
  const bool has_additions = !model.adaptation.empty() && std::filesystem::exists(additions, error);
  return Pronunciation(model.dictionary, model.guess_words, has_additions ? additions.string() : "")
      .dictionaryOf(words);
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

struct SphinxDecoder::Impl
{
  Impl(const SphinxModel& model, const std::vector<std::string>& grammars, const std::string& dictionary)
    : engine(checked(model, grammars, dictionary), dictionary, grammars)
  {
  }

  /// One grammar is enough to find out whether the model is good.
  static const SphinxModel& checked(const SphinxModel& model, const std::vector<std::string>& grammars,
                                    const std::string& dictionary)
  {
    if (model.check_model)
    {
      checkSpeechModel(model, dictionary, grammars.empty() ? std::string() : grammars.front());
    }
    return model;
  }

  SphinxEngine engine;
};

SphinxDecoder::SphinxDecoder(const SphinxModel& model, const std::vector<std::string>& grammars,
                             const std::vector<std::string>& words)
  : impl_(std::make_unique<Impl>(model, grammars, grammars.empty() ? std::string() : dictionaryOf(model, words)))
{
}

SphinxDecoder::~SphinxDecoder() = default;

void SphinxDecoder::listen(const int16_t* samples, size_t count)
{
  impl_->engine.listen(samples, count);
}

SphinxHypothesis SphinxDecoder::find(size_t grammar)
{
  return impl_->engine.find(grammar);
}

SphinxHypothesis SphinxDecoder::findPhones()
{
  return impl_->engine.findPhones();
}

SphinxHypothesis SphinxDecoder::decode(const int16_t* samples, size_t count)
{
  return impl_->engine.decode(samples, count);
}

}  // namespace pi_speech
