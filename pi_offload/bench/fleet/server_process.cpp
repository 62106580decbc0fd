#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "fleet/server_process.h"

namespace pi_offload_bench
{
namespace
{

constexpr time_t ANSWER_S = 5;

[[noreturn]] void failed(const std::string& what)
{
  throw std::runtime_error(what + ": " + std::strerror(errno));
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
  : program_(program, "--config", config,
             [](const std::string& log) { return !between(log, "health at port ", "\n").empty(); })
  , address_(between(program_.beginning(), " works at ", ","))
  , health_port_(std::stoi(between(program_.beginning(), "health at port ", "\n")))
{
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
  std::ifstream file("/proc/" + std::to_string(program_.process()) + "/stat");
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

}  // namespace pi_offload_bench
