// check_model MODEL: whether OpenCV can load and run a model; tells its kind, or why not, on the standard output.
// The library runs it as a child process, since OpenCV can crash on a damaged file.

#include <pi_detect/model_catalogue.h>
#include <pi_detect/model_check.h>
#include <pi_node/command_line.h>
#include <sys/resource.h>
#include "ros/packaged_models.h"

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
  std::string description = pi_detect::DEFAULT_MODEL;
  int memory_mb = pi_detect::ModelCheckOptions().memory_limit_mb;
  pi_node::CommandLine options("check_model [NAME_OR_YAML]");
  options.addValue("memory-mb", &memory_mb, "address space that loading may take [MB]");
  options.addPositional("model", &description, "");
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
    // ROS is not asked for what the library calls this for.
    const std::string models = pi_detect::isModelPath(description) ? "" : pi_detect::packagedModels();
    const auto model = pi_detect::chooseModel(description, models);
    pi_detect::checkModelHere(model.description);
    std::cout << model.description.path << ": " << model.description.name << " is usable, output/kind "
              << toString(model.description.output_kind) << "\n";
    if (!model.notice.empty())
    {
      std::cout << model.notice << "\n";
    }
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
