#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "server_process.h"

namespace pi_offload_bench
{
namespace
{

constexpr int START_S = 60;
constexpr time_t ANSWER_S = 5;

[[noreturn]] void failed(const std::string& what)
{
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

/// What stands between two texts; empty if they are not there.
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

std::string get(int port, const std::string& path)
{
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0)
  {
    failed("socket");
  }
  const timeval limit{ANSWER_S, 0};
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const std::string request = "GET " + path + " HTTP/1.0\r\n\r\n";
  std::string answer;
  char part[4096];
  ssize_t count = -1;
  if (connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
      send(fd, request.data(), request.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(request.size()))
  {
    while ((count = read(fd, part, sizeof part)) > 0)
    {
      answer.append(part, static_cast<size_t>(count));
    }
  }
  const int error = errno;
  close(fd);
  if (count != 0)
  {
    errno = error;
    failed("port " + std::to_string(port) + path);
  }
  return answer;
}

}  // namespace

ServerProcess::ServerProcess(const std::string& program, const std::string& config)
{
  // The file is only in memory, and the child has it open.
  const int file = memfd_create("edge_server.yaml", 0);
  int log[2];
  if (file < 0 || write(file, config.data(), config.size()) != static_cast<ssize_t>(config.size()) ||
      pipe2(log, O_CLOEXEC) != 0)
  {
    failed("edge_server's file");
  }
  const std::string path = "/proc/self/fd/" + std::to_string(file);
  process_ = fork();
  if (process_ < 0)
  {
    failed("fork");
  }
  if (process_ == 0)
  {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(log[1], STDOUT_FILENO);
    dup2(log[1], STDERR_FILENO);
    execl(program.c_str(), program.c_str(), "--config", path.c_str(), static_cast<char*>(nullptr));
    const std::string text = program + ": " + std::strerror(errno) + "\n";
    _exit(write(STDERR_FILENO, text.data(), text.size()) < 0 ? 126 : 127);
  }
  close(file);
  close(log[1]);
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(START_S);
  while (address_.empty())
  {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
    pollfd ready{log[0], POLLIN, 0};
    char part[4096];
    const bool readable = left.count() > 0 && poll(&ready, 1, static_cast<int>(left.count())) > 0;
    const ssize_t count = readable ? read(log[0], part, sizeof part) : -1;
    if (count <= 0)
    {
      close(log[0]);
      kill(process_, SIGKILL);
      waitpid(process_, nullptr, 0);
      throw std::runtime_error("edge_server does not begin to work; it said:\n" + log_);
    }
    log_.append(part, static_cast<size_t>(count));
    const std::string health = between(log_, "health at port ", "\n");
    if (!health.empty())
    {
      health_port_ = std::stoi(health);
      address_ = between(log_, " works at ", ",");
    }
  }
  reader_ = std::thread([this, from = log[0]] { readLog(from); });
}

ServerProcess::~ServerProcess()
{
  if (process_ > 0)
  {
    kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
  }
  reader_.join();
}

/// Until its end, so that it never waits for a full pipe.
void ServerProcess::readLog(int from)
{
  char part[4096];
  ssize_t count = 0;
  while ((count = read(from, part, sizeof part)) > 0 || (count < 0 && errno == EINTR))
  {
    log_.append(part, static_cast<size_t>(count > 0 ? count : 0));
  }
  close(from);
}

std::map<std::string, double> ServerProcess::metrics() const
{
  std::istringstream text(get(health_port_, "/metrics"));
  std::map<std::string, double> values;
  for (std::string line; std::getline(text, line);)
  {
    const size_t space = line.rfind(' ');
    if (line.rfind("pi_offload_", 0) == 0 && space != std::string::npos)
    {
      values[line.substr(0, space)] = std::stod(line.substr(space + 1));
    }
  }
  return values;
}

double ServerProcess::processorSeconds() const
{
  std::ifstream file("/proc/" + std::to_string(process_) + "/stat");
  std::string text;
  std::getline(file, text);
  // Fields 14 and 15; counted from behind the name, which may hold spaces.
  std::istringstream fields(text.substr(text.rfind(')') + 1));
  std::string skipped;
  for (int i = 3; i < 14; ++i)
  {
    fields >> skipped;
  }
  double user = 0.0;
  double system = 0.0;
  fields >> user >> system;
  return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

int ServerProcess::end()
{
  kill(process_, SIGTERM);
  int status = 0;
  waitpid(process_, &status, 0);
  process_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace pi_offload_bench
