// check_speech_model FOLDER: whether PocketSphinx can load an acoustic model and decode sound with it; says why not on
// the standard output. The library runs it as a child process, since PocketSphinx ends the process or crashes on some
// damaged files. Standard input: lines of a dictionary, an empty line, a grammar in JSGF; without a grammar the model
// is loaded for dictation. Ends with 0: good, 2: not, with the reason, anything else: by PocketSphinx itself.

#include "sphinx/speech_model_check.h"
#include <sys/resource.h>

#include <boost/program_options.hpp>
#include <cstdlib>
#include <iostream>
#include <iterator>
#include <new>
#include <string>

namespace
{

namespace po = boost::program_options;

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
  po::options_description options("check_speech_model FOLDER < DICTIONARY_AND_GRAMMAR");
  options.add_options()("help", "prints this")("memory-mb", po::value(&memory_mb)->default_value(memory_mb),
                                               "address space that loading may take [MB]")(
      "dictionary", po::value(&model.dictionary)->default_value(model.dictionary), "of dictation")(
      "language-model", po::value(&model.language_model)->default_value(model.language_model), "of dictation")(
      "adaptation", po::value(&model.adaptation)->default_value(""), "folder of an adaptation; empty: none")(
      "model", po::value(&model.acoustic_model)->required(), "folder of the acoustic model");
  po::positional_options_description positional;
  positional.add("model", 1);
  try
  {
    po::variables_map values;
    po::store(po::command_line_parser(argc, argv).options(options).positional(positional).run(), values);
    if (values.count("help") != 0)
    {
      std::cout << options;
      return EXIT_SUCCESS;
    }
    po::notify(values);
  }
  catch (const po::error& error)
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
