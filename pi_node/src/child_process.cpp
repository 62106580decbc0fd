#include <fcntl.h>
#include <pi_node/child_process.h>
#include <pi_node/unique_fd.h>
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
#include <stdexcept>

extern char** environ;

namespace pi_node
{
namespace
{

constexpr size_t MAX_OUTPUT = 4096;

/// Kills its process at the end of its life, unless wait() was called.
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
  UniqueFd input;
  UniqueFd output;
  Pipe()
  {
    int ends[2] = {-1, -1};
    if (pipe2(ends, O_CLOEXEC) != 0)
    {
      throw std::runtime_error(std::string("no pipe to a child process: ") + std::strerror(errno) +
                               "; raise the limit of open files of this process");
    }
    input = UniqueFd(ends[0]);
    output = UniqueFd(ends[1]);
  }
};

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

pid_t start(const std::string& program, std::vector<std::string>& arguments, const ChildOptions& options, int output)
{
  std::vector<char*> pointers = {const_cast<char*>(program.c_str())};
  for (std::string& argument : arguments)
  {
    pointers.push_back(argument.data());
  }
  pointers.push_back(nullptr);
  std::vector<char*> variables = childEnvironment();
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  if (options.input >= 0)
  {
    posix_spawn_file_actions_adddup2(&actions, options.input, STDIN_FILENO);
  }
  else
  {
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  }
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  if (options.take_errors)
  {
    posix_spawn_file_actions_adddup2(&actions, output, STDERR_FILENO);
  }
  else
  {
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  }
  pid_t pid = -1;
  const int error = posix_spawn(&pid, program.c_str(), &actions, nullptr, pointers.data(), variables.data());
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0)
  {
    throw std::runtime_error(program + ": cannot be started: " + std::strerror(error));
  }
  return pid;
}

/// Reads until the other end is closed. @return false after the timeout.
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
    text->append(block.data(), std::min(static_cast<size_t>(bytes), MAX_OUTPUT - std::min(MAX_OUTPUT, text->size())));
  }
}

}  // namespace

bool ChildResult::wasInterrupted() const
{
  const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  return signal == SIGINT || signal == SIGTERM || signal == SIGHUP;
}

ChildResult runChild(const std::string& program, std::vector<std::string> arguments, const ChildOptions& options)
{
  ChildResult result;
  Pipe pipe;
  Child child(start(program, arguments, options, pipe.output.get()));
  pipe.output.reset();
  result.in_time = readAll(pipe.input.get(), options.timeout_s, &result.output);
  if (result.in_time)
  {
    result.status = child.wait();
  }
  return result;
}

}  // namespace pi_node
