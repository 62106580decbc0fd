#include <dlfcn.h>
#include <pi_node/child_process.h>
#include "sphinx/speech_model_check.h"
#include <sys/wait.h>

#include <cstring>
#include <filesystem>
#include <random>
#include <sstream>
#include <stdexcept>

#include "sphinx/memory_file.h"
#include "sphinx/sphinx_engine.h"

namespace pi_speech
{
namespace
{

constexpr char PROGRAM[] = "check_speech_model";

/// lib/pi_speech/check_speech_model beside this library's lib/.
std::string installedProgram()
{
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&installedProgram), &info) == 0 || info.dli_fname == nullptr)
  {
    return PROGRAM;
  }
  return (std::filesystem::absolute(info.dli_fname).parent_path() / "pi_speech" / PROGRAM).string();
}

std::string lastLine(std::string text)
{
  while (!text.empty() && text.back() == '\n')
  {
    text.pop_back();
  }
  const size_t end = text.rfind('\n');
  return end == std::string::npos ? text : text.substr(end + 1);
}

/// 0.3 s of noise of the loudness of speech: dictation takes long for noise.
Samples noise()
{
  std::mt19937 generator(1);
  Samples samples(SAMPLE_RATE_HZ * 3 / 10);
  for (int16_t& sample : samples)
  {
    sample = static_cast<int16_t>(static_cast<int>(generator() % 4001) - 2000);
  }
  return samples;
}

}  // namespace

void checkSpeechModelHere(const SphinxModel& model, const std::string& dictionary, const std::string& jsgf)
{
  const bool dictation = jsgf.empty();
  SphinxEngine engine(model, dictionary, dictation ? std::vector<std::string>() : std::vector<std::string>{jsgf});
  const Samples samples = noise();
  engine.decode(samples.data(), samples.size());
  if (!dictation)
  {
    engine.findPhones();
  }
}

void checkSpeechModel(const SphinxModel& model, const std::string& dictionary, const std::string& jsgf,
                      const SpeechModelCheckOptions& options)
{
  checkSphinxFiles(model, jsgf.empty());
  const std::string program = options.program.empty() ? installedProgram() : options.program;
  const MemoryFile input(dictionary + "\n" + jsgf);
  pi_node::ChildOptions child;
  child.timeout_s = options.timeout_s;
  child.input = input.descriptor();
  pi_node::ChildResult result;
  try
  {
    result = pi_node::runChild(
        program,
        {"--memory-mb", std::to_string(options.memory_limit_mb), "--dictionary", model.dictionary, "--language-model",
         model.language_model, "--adaptation", model.adaptation, model.acoustic_model},
        child);
  }
  catch (const std::runtime_error& error)
  {
    throw std::runtime_error(std::string(error.what()) +
                             "; it checks the acoustic model: install the package whole, or switch check_model off");
  }
  const std::string way_out = "; install it again, or give another model";
  if (!result.in_time)
  {
    std::ostringstream text;
    text << model.acoustic_model << ": loading it took longer than " << options.timeout_s
         << " s: a file of the model is damaged, or the machine too slow for it" << way_out;
    throw std::runtime_error(text.str());
  }
  const std::string said = lastLine(result.output);
  if (result.wasInterrupted())
  {
    throw std::runtime_error(model.acoustic_model + ": the check of it was ended from outside (" +
                             strsignal(WTERMSIG(result.status)) + "); load it again");
  }
  if (WIFSIGNALED(result.status))
  {
    throw std::runtime_error(model.acoustic_model + ": PocketSphinx crashes on this model (" +
                             strsignal(WTERMSIG(result.status)) + "): a file of it is damaged" + way_out);
  }
  if (WEXITSTATUS(result.status) == 2 && !said.empty())
  {
    throw std::runtime_error(said);  // by the check itself: a whole sentence
  }
  if (result.status != 0)
  {
    throw std::runtime_error(model.acoustic_model + ": PocketSphinx cannot load this model: " +
                             (said.empty() ? "it ends the process and says nothing" : said) + way_out);
  }
}

}  // namespace pi_speech
