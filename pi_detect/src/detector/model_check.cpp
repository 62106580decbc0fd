#include <pi_detect/model_check.h>

#include <dlfcn.h>
#include <pi_node/child_process.h>
#include <sys/wait.h>

#include <boost/algorithm/string.hpp>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>

#include "detector/network.h"

namespace pi_detect
{
namespace
{

constexpr char PROGRAM[] = "check_model";

/// lib/pi_detect/check_model beside this library's lib/.
std::string installedProgram()
{
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&installedProgram), &info) == 0 || info.dli_fname == nullptr)
  {
    return PROGRAM;
  }
  return (std::filesystem::absolute(info.dli_fname).parent_path() / "pi_detect" / PROGRAM).string();
}

}  // namespace

void checkModelHere(const ModelDescription& model)
{
  checkFiles(model);
  Network network(model, TargetInUse());
}

void checkModel(const ModelDescription& model, const ModelCheckOptions& options)
{
  checkFiles(model);
  const std::string program = options.program.empty() ? installedProgram() : options.program;
  pi_node::ChildOptions child;
  child.timeout_s = options.timeout_s;
  child.take_errors = false;  // OpenCV's own log
  pi_node::ChildResult result;
  try
  {
    result = pi_node::runChild(program, {"--memory-mb", std::to_string(options.memory_limit_mb), model.path}, child);
  }
  catch (const std::runtime_error& error)
  {
    throw ModelError(std::string(error.what()) +
                     "; it checks the model: install the package whole, or switch check_model off");
  }
  if (!result.in_time)
  {
    throw ModelError(model.weights.path + ": loading it took longer than " + std::to_string(options.timeout_s) +
                     " s: the file is damaged, or the machine too slow for it");
  }
  const int status = result.status;
  std::string& message = result.output;
  if (result.wasInterrupted())
  {
    throw ModelError(model.weights.path + ": the check of it was ended from outside (" + strsignal(WTERMSIG(status)) +
                     "); load it again");
  }
  if (WIFSIGNALED(status))
  {
    throw ModelError(model.weights.path + ": OpenCV crashes on it (" + strsignal(WTERMSIG(status)) +
                     "): the file is damaged or not meant for this version of OpenCV; fetch it again");
  }
  if (WEXITSTATUS(status) != 0)
  {
    boost::trim_right_if(message, boost::is_any_of("\n"));
    throw ModelError(message.empty() ? model.weights.path + ": the check ended with status " +
                                           std::to_string(WEXITSTATUS(status)) + " and said nothing"
                                     : message);
  }
}

}  // namespace pi_detect
