// check_speech_model FOLDER: whether PocketSphinx can load an acoustic model and decode sound with it; says why not on
// the standard output. The library runs it as a child process, since PocketSphinx ends the process or crashes on some
// damaged files. Standard input: lines of a dictionary, an empty line, a grammar in JSGF; without a grammar the model
// is loaded for dictation. Ends with 0: good, 2: not, with the reason, anything else: by PocketSphinx itself.

#include <pi_node/command_line.h>
#include <sys/resource.h>

#include <cstdlib>
#include <iostream>
#include <iterator>
#include <new>
#include <string>

#include "sphinx/speech_model_check.h"

namespace
{

constexpr int BAD_MODEL = 2;

void limit(int resource, rlim_t value)
{
  const rlimit limits{value, value};
  setrlimit(static_cast<__rlimit_resource>(resource), &limits);
}

}  // namespace

int main(int argc, char** argv)
{
  pi_speech::SphinxModel model;
  int memory_mb = pi_speech::SpeechModelCheckOptions().memory_limit_mb;
  pi_node::CommandLine options("check_speech_model FOLDER < DICTIONARY_AND_GRAMMAR");
  options.addValue("memory-mb", &memory_mb, "address space that loading may take [MB]");
  options.addValue("dictionary", &model.dictionary, "of dictation");
  options.addValue("language-model", &model.language_model, "of dictation");
  options.addValue("adaptation", &model.adaptation, "folder of an adaptation; empty: none");
  options.addPositional("model", &model.acoustic_model, "no folder of an acoustic model is named");
  try
  {
    if (!options.parse(argc, argv))
    {
      return EXIT_SUCCESS;
    }
  }
  catch (const std::exception& error)
  {
    std::cout << "check_speech_model: " << error.what() << "\n";
    return BAD_MODEL;
  }
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_AS, static_cast<rlim_t>(memory_mb) << 20);
  try
  {
    const std::string input{std::istreambuf_iterator<char>(std::cin), std::istreambuf_iterator<char>()};
    const size_t end = input.find("\n\n");
    const std::string dictionary = end != std::string::npos ? input.substr(0, end + 1) : "";
    const size_t jsgf = input.find("#JSGF");
    pi_speech::checkSpeechModelHere(model, dictionary, jsgf != std::string::npos ? input.substr(jsgf) : "");
    return EXIT_SUCCESS;
  }
  catch (const std::bad_alloc&)
  {
    std::cout << model.acoustic_model << ": loading takes more than " << memory_mb
              << " MB: a file of the model is damaged or too large; install it again, or give another model\n";
  }
  catch (const std::exception& error)
  {
    std::cout << error.what() << "\n";
  }
  return BAD_MODEL;
}
