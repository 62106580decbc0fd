#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <stdexcept>

#include "fleet/program.h"

namespace pi_offload_bench
{
namespace
{

constexpr int START_S = 60;

}  // namespace

std::string between(const std::string& text, const std::string& before, const std::string& after)
{
  const size_t begin = text.find(before);
  if (begin == std::string::npos)
  {
    return "";
  }
  const size_t end = text.find(after, begin + before.size());
  return end == std::string::npos ? "" : text.substr(begin + before.size(), end - begin - before.size());
}

Program::Program(const std::string& program, const std::string& option, const std::string& config,
                 const std::function<bool(const std::string& log)>& works)
{
  // The file is only in memory, and the child has it open.
  const int file = memfd_create("config.yaml", 0);
  int log[2];
  if (file < 0 || write(file, config.data(), config.size()) != static_cast<ssize_t>(config.size()) ||
      pipe2(log, O_CLOEXEC) != 0)
  {
    throw std::runtime_error("the file for " + program + ": " + std::strerror(errno));
  }
  const std::string path = "/proc/self/fd/" + std::to_string(file);
  process_ = fork();
  if (process_ < 0)
  {
    throw std::runtime_error(std::string("fork: ") + std::strerror(errno));
  }
  if (process_ == 0)
  {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(log[1], STDOUT_FILENO);
    dup2(log[1], STDERR_FILENO);
    execlp(program.c_str(), program.c_str(), option.c_str(), path.c_str(), static_cast<char*>(nullptr));
    const std::string text = program + ": " + std::strerror(errno) + "\n";
    _exit(write(STDERR_FILENO, text.data(), text.size()) < 0 ? 126 : 127);
  }
  close(file);
  close(log[1]);
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(START_S);
  while (!works(log_))
  {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
    pollfd ready{log[0], POLLIN, 0};
    char part[4096];
    const bool readable = left.count() > 0 && poll(&ready, 1, static_cast<int>(left.count())) > 0;
    const ssize_t count = readable ? read(log[0], part, sizeof part) : -1;
    if (count <= 0)
    {
      close(log[0]);
      ::kill(process_, SIGKILL);
      waitpid(process_, nullptr, 0);
      throw std::runtime_error(program + " does not begin to work; it said:\n" + log_);
    }
    log_.append(part, static_cast<size_t>(count));
  }
  reader_ = std::thread([this, from = log[0]] { readLog(from); });
}

Program::~Program()
{
  kill();
  reader_.join();
}

/// Until its end, so that it never waits for a full pipe.
void Program::readLog(int from)
{
  char part[4096];
  ssize_t count = 0;
  while ((count = read(from, part, sizeof part)) > 0 || (count < 0 && errno == EINTR))
  {
  }
  close(from);
}

void Program::kill()
{
  if (process_ > 0)
  {
    ::kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
    process_ = -1;
  }
}

int Program::end()
{
  ::kill(process_, SIGTERM);
  int status = 0;
  waitpid(process_, &status, 0);
  process_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace pi_offload_bench
