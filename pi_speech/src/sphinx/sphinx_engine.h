#pragma once

#include <pi_speech/sphinx_decoder.h>

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "sphinx/held_folder.h"
#include "sphinx/memory_file.h"

struct cmd_ln_s;
struct ps_decoder_s;

namespace pi_speech
{

/// @throws std::runtime_error naming the first file of the model that is missing or empty, and the way out.
void checkSphinxFiles(const SphinxModel& model, bool dictation);

/// A folder for the files that PocketSphinx writes, one per utterance. They are links to a file in memory.
class NamedScores
{
public:
  /// @throws std::runtime_error if there is no room for a folder.
  explicit NamedScores(const MemoryFile& file) : target_(file.path()) {}
  NamedScores(const NamedScores&) = delete;
  NamedScores& operator=(const NamedScores&) = delete;

  const std::string& folder() const { return folder_.path(); }
  /// While it lives the utterance's file is in the folder.
  class Link
  {
  public:
    Link(const NamedScores& scores, int utterance);
    ~Link();
    Link(const Link&) = delete;
    Link& operator=(const Link&) = delete;

  private:
    std::string path_;
  };

private:
  const std::string target_;
  const HeldFolder folder_;
};

/// Two decoders of PocketSphinx, without the precautions of SphinxDecoder: a damaged model can end the process.
///
/// One decoder computes the likelihoods of all states and writes them to a file in memory; the other one searches them.
/// The second decoder must not get sound: it would search what is left of that after the likelihoods.
class SphinxEngine
{
public:
  /// @param dictionary  lines for the words of the grammars; not used for dictation.
  /// @param grammars    in JSGF; none: dictation.
  /// @throws std::runtime_error naming folder, what PocketSphinx says, and the way out.
  SphinxEngine(const SphinxModel& model, const std::string& dictionary, const std::vector<std::string>& grammars);
  ~SphinxEngine();
  SphinxEngine(const SphinxEngine&) = delete;
  SphinxEngine& operator=(const SphinxEngine&) = delete;

  void listen(const int16_t* samples, size_t count);
  SphinxHypothesis find(size_t grammar);
  SphinxHypothesis findPhones();
  SphinxHypothesis decode(const int16_t* samples, size_t count);

private:
  struct Free
  {
    void operator()(cmd_ln_s* config) const;
    void operator()(ps_decoder_s* decoder) const;
  };
  struct Decoder
  {
    std::unique_ptr<cmd_ln_s, Free> config;
    std::unique_ptr<ps_decoder_s, Free> decoder;
  };

  Decoder load(const std::string& dictionary, bool scores) const;
  void loadGrammar(Decoder* decoder, size_t number, const std::string& jsgf) const;
  /// Gives sound to the scorer. @return number of frames.
  int process(const int16_t* samples, size_t count);
  SphinxHypothesis search(const std::string& name);
  SphinxHypothesis hypothesisOf(ps_decoder_s* decoder, int frames) const;

  const SphinxModel model_;
  const size_t grammars_;  ///< 0: dictation
  std::set<std::string> fillers_;
  const MemoryFile scores_;  ///< of the utterance that was listened to last
  const NamedScores named_scores_;
  int utterances_ = 0;  ///< that the scorer has begun
  int frames_ = 0;      ///< of the last; 0: too short
  Decoder scorer_;
  Decoder searcher_;  ///< none for dictation
};

}  // namespace pi_speech
