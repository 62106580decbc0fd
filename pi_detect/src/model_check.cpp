#include "pi_detect/model_check.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <vector>

#include "network.h"

extern char** environ;

namespace pi_detect
{
namespace
{

constexpr char PROGRAM[] = "check_model";
constexpr size_t MAX_MESSAGE = 4096;

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

/// A process that is killed, and waited for, unless it was before.
class Child
{
public:
  explicit Child(pid_t pid) : pid_(pid) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child()
  {
    if (!waited_)
    {
      kill(pid_, SIGKILL);
      wait();
    }
  }
  int wait()
  {
    int status = 0;
    while (waitpid(pid_, &status, 0) == -1 && errno == EINTR)
    {
    }
    waited_ = true;
    return status;
  }

private:
  const pid_t pid_;
  bool waited_ = false;
};

struct Pipe
{
  int ends[2] = {-1, -1};
  Pipe()
  {
    if (pipe2(ends, O_CLOEXEC) != 0)
    {
      throw ModelError(std::string("model check: no pipe: ") + std::strerror(errno));
    }
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  ~Pipe()
  {
    closeEnd(0);
    closeEnd(1);
  }
  void closeEnd(int end)
  {
    if (ends[end] != -1)
    {
      close(ends[end]);
      ends[end] = -1;
    }
  }
};

/// The environment without libraries to preload, which the child has no use for.
std::vector<char*> childEnvironment()
{
  std::vector<char*> variables;
  for (char** variable = environ; *variable != nullptr; ++variable)
  {
    if (std::strncmp(*variable, "LD_PRELOAD=", 11) != 0)
    {
      variables.push_back(*variable);
    }
  }
  variables.push_back(nullptr);
  return variables;
}

pid_t start(const std::string& program, std::vector<std::string> arguments, int output)
{
  std::vector<char*> pointers;
  for (std::string& argument : arguments)
  {
    pointers.push_back(argument.data());
  }
  pointers.push_back(nullptr);
  std::vector<char*> variables = childEnvironment();
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);  // OpenCV's own log
  pid_t pid = -1;
  const int error = posix_spawn(&pid, program.c_str(), &actions, nullptr, pointers.data(), variables.data());
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0)
  {
    throw ModelError(program + ": cannot be started to check a model: " + std::strerror(error) +
                     "; install the package whole, or switch check_model off");
  }
  return pid;
}

/// All that comes until the other end is closed. @return false if that is not so in time.
bool readAll(int input, double timeout_s, std::string* text)
{
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(timeout_s));
  std::array<char, 1024> block{};
  while (true)
  {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
    pollfd entry{input, POLLIN, 0};
    const int ready = left > 0 ? poll(&entry, 1, static_cast<int>(left)) : 0;
    if (ready == 0)
    {
      return false;
    }
    if (ready < 0 && errno == EINTR)
    {
      continue;
    }
    const ssize_t bytes = read(input, block.data(), block.size());
    if (bytes <= 0)
    {
      return true;
    }
    text->append(block.data(), std::min(static_cast<size_t>(bytes), MAX_MESSAGE - std::min(MAX_MESSAGE, text->size())));
  }
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
  Pipe pipe;
  Child child(
      start(program, {program, "--memory-mb", std::to_string(options.memory_limit_mb), model.path}, pipe.ends[1]));
  pipe.closeEnd(1);
  std::string message;
  if (!readAll(pipe.ends[0], options.timeout_s, &message))
  {
    throw ModelError(model.weights.path + ": loading it took longer than " + std::to_string(options.timeout_s) +
                     " s: the file is damaged, or the machine too slow for it");
  }
  const int status = child.wait();
  if (WIFSIGNALED(status))
  {
    throw ModelError(model.weights.path + ": OpenCV crashes on it (" + strsignal(WTERMSIG(status)) +
                     "): the file is damaged or not meant for this version of OpenCV; fetch it again");
  }
  if (WEXITSTATUS(status) != 0)
  {
    while (!message.empty() && message.back() == '\n')
    {
      message.pop_back();
    }
    throw ModelError(message.empty() ? model.weights.path + ": the check ended with status " +
                                           std::to_string(WEXITSTATUS(status)) + " and said nothing"
                                     : message);
  }
}

}  // namespace pi_detect
