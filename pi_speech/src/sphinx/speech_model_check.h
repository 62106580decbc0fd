#pragma once

#include <pi_speech/sphinx_decoder.h>

#include <string>

namespace pi_speech
{

struct SpeechModelCheckOptions
{
  double timeout_s = 60.0;     ///< for loading and 0.3 s of sound; at least 0.001
  int memory_limit_mb = 1024;  ///< address space of the child
  std::string program;         ///< check_speech_model; empty: the one installed beside this library
};

/// Loads a model and decodes some noise with it in a child process, since PocketSphinx ends the process, or
/// crashes, on some files that are damaged. Blocks. Thread safe.
/// @param dictionary  lines for the words of the grammar.
/// @param jsgf        grammar; empty: dictation, with dictionary and language model of the model.
/// @throws std::runtime_error with the reason: what is missing, what PocketSphinx says, or the signal that ended the
///   child.
void checkSpeechModel(const SphinxModel& model, const std::string& dictionary, const std::string& jsgf,
                      const SpeechModelCheckOptions& options = SpeechModelCheckOptions());

/// What check_speech_model does, in this process. @throws std::runtime_error. May crash or end the process.
void checkSpeechModelHere(const SphinxModel& model, const std::string& dictionary, const std::string& jsgf);

}  // namespace pi_speech
