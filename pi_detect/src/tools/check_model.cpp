// check_model MODEL.yaml: whether OpenCV can load and run a model; says why not on the standard output. The library
// runs it as a child process, since OpenCV can crash on a damaged file.

#include <pi_detect/model_check.h>
#include <sys/resource.h>

#include <boost/program_options.hpp>
#include <cstdlib>
#include <iostream>
#include <new>

namespace
{

namespace po = boost::program_options;

void limit(int resource, rlim_t value)
{
  const rlimit limits{value, value};
  setrlimit(static_cast<__rlimit_resource>(resource), &limits);
}

}  // namespace

int main(int argc, char** argv)
{
  std::string description;
  int memory_mb = pi_detect::ModelCheckOptions().memory_limit_mb;
  po::options_description options("check_model MODEL.yaml");
  options.add_options()("help", "prints this")("memory-mb", po::value(&memory_mb)->default_value(memory_mb),
                                               "address space that loading may take [MB]")(
      "model", po::value(&description)->required(), "description of the model");
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
    std::cout << "check_model: " << error.what() << "\n";
    return 2;
  }
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_AS, static_cast<rlim_t>(memory_mb) << 20);
  try
  {
    pi_detect::checkModelHere(pi_detect::ModelDescription::load(description));
    return EXIT_SUCCESS;
  }
  catch (const std::bad_alloc&)
  {
    std::cout << description << ": loading takes more than " << memory_mb << " MB: the model is damaged or too large\n";
  }
  catch (const std::exception& error)
  {
    std::cout << error.what() << "\n";
  }
  return EXIT_FAILURE;
}
