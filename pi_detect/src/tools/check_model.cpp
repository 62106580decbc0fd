// check_model MODEL.yaml: whether OpenCV can load and run a model; tells its kind, or why not, on the standard output.
// The library runs it as a child process, since OpenCV can crash on a damaged file.

#include <pi_detect/model_check.h>
#include <pi_node/command_line.h>
#include <sys/resource.h>

#include <cstdlib>
#include <iostream>
#include <new>

namespace
{

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
  pi_node::CommandLine options("check_model MODEL.yaml");
  options.addValue("memory-mb", &memory_mb, "address space that loading may take [MB]");
  options.addPositional("model", &description, "no description of a model is named");
  try
  {
    if (!options.parse(argc, argv))
    {
      return EXIT_SUCCESS;
    }
  }
  catch (const std::exception& error)
  {
    std::cout << "check_model: " << error.what() << "\n";
    return pi_node::CommandLine::BAD_USAGE;
  }
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_AS, static_cast<rlim_t>(memory_mb) << 20);
  try
  {
    const auto model = pi_detect::ModelDescription::load(description);
    pi_detect::checkModelHere(model);
    std::cout << description << ": " << model.name << " is usable, output/kind " << toString(model.output_kind) << "\n";
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
