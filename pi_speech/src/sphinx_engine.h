#pragma once

#include <pi_speech/sphinx_decoder.h>

#include <memory>
#include <set>
#include <string>

struct cmd_ln_s;
struct ps_decoder_s;

namespace pi_speech
{

/// @throws std::runtime_error naming the first file of the model that is missing or empty, and the way out.
void checkSphinxFiles(const SphinxModel& model, bool dictation);

/// A decoder of PocketSphinx, without the precautions of SphinxDecoder: a damaged model can end the process.
class SphinxEngine
{
public:
  /// @param dictionary  lines for the words of the grammar; not used for dictation.
  /// @param jsgf        grammar; empty: dictation.
  /// @throws std::runtime_error naming folder, what PocketSphinx says, and the way out.
  SphinxEngine(const SphinxModel& model, const std::string& dictionary, const std::string& jsgf);
  ~SphinxEngine();
  SphinxEngine(const SphinxEngine&) = delete;
  SphinxEngine& operator=(const SphinxEngine&) = delete;

  SphinxHypothesis decode(const int16_t* samples, size_t count);
  double phoneLoopScore(const int16_t* samples, size_t count, int first_frame, int last_frame);

private:
  void loadGrammar(const std::string& jsgf);
  void loadPhoneLoop();
  /// @return its number of frames.
  int process(const char* search, const int16_t* samples, size_t count);
  double toLogLikelihood(double score, int frames) const;

  struct Free
  {
    void operator()(cmd_ln_s* config) const;
    void operator()(ps_decoder_s* decoder) const;
  };

  const SphinxModel model_;
  std::unique_ptr<cmd_ln_s, Free> config_;
  std::unique_ptr<ps_decoder_s, Free> decoder_;
  std::set<std::string> fillers_;
};

}  // namespace pi_speech
