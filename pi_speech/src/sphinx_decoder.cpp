#include <pi_speech/pronunciation.h>
#include <pi_speech/speech_model_check.h>
#include <pi_speech/sphinx_decoder.h>

#include <filesystem>

#include "sphinx_engine.h"

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
  Impl(const SphinxModel& model, const std::string& jsgf, const std::string& dictionary)
    : engine(checked(model, jsgf, dictionary), dictionary, jsgf)
  {
  }

  static const SphinxModel& checked(const SphinxModel& model, const std::string& jsgf, const std::string& dictionary)
  {
    if (model.check_model)
    {
      checkSpeechModel(model, dictionary, jsgf);
    }
    return model;
  }

  SphinxEngine engine;
};

SphinxDecoder::SphinxDecoder(const SphinxModel& model, const std::string& jsgf, const std::vector<std::string>& words)
  : impl_(std::make_unique<Impl>(model, jsgf, jsgf.empty() ? std::string() : dictionaryOf(model, words)))
{
}

SphinxDecoder::~SphinxDecoder() = default;

SphinxHypothesis SphinxDecoder::decode(const int16_t* samples, size_t count)
{
  return impl_->engine.decode(samples, count);
}

double SphinxDecoder::phoneLoopScore(const int16_t* samples, size_t count, int first_frame, int last_frame)
{
  return impl_->engine.phoneLoopScore(samples, count, first_frame, last_frame);
}

}  // namespace pi_speech
