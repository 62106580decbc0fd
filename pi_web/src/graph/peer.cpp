#include "graph/peer.h"

#include "protocol/messages.h"

#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <memory>
#include <stdexcept>

namespace pi_web
{
namespace
{

int64_t monotonicNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

Peer::Peer(const std::string& host, uint16_t port, double limit_s)
  : name_(host + ":" + std::to_string(port)), until_ns_(monotonicNs() + static_cast<int64_t>(limit_s * 1e9))
{
  addrinfo hints = {};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found); error != 0)
  {
    throw std::runtime_error(name_ + ": " + gai_strerror(error));
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, freeaddrinfo);
  socket_ = pi_node::UniqueFd(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (connect(socket_.get(), found->ai_addr, found->ai_addrlen) != 0 && errno != EINPROGRESS)
  {
    throw std::runtime_error(name_ + ": " + std::strerror(errno));
  }
  wait(POLLOUT);
  int error = 0;
  socklen_t size = sizeof error;
  getsockopt(socket_.get(), SOL_SOCKET, SO_ERROR, &error, &size);
  if (error != 0)
  {
    throw std::runtime_error(name_ + ": " + std::strerror(error));
  }
}

void Peer::wait(short events) const
{
  while (true)
  {
    pollfd one = {socket_.get(), events, 0};
    const int64_t left_ms = (until_ns_ - monotonicNs()) / 1000000;
    const int ready = left_ms > 0 ? poll(&one, 1, static_cast<int>(left_ms)) : 0;
    if (ready > 0)
    {
      return;
    }
    if (ready == 0)
    {
      throw std::runtime_error(name_ + " does not answer in time");
    }
    if (errno != EINTR)
    {
      throw std::runtime_error(name_ + ": " + std::strerror(errno));
    }
  }
}

void Peer::write(const std::string& bytes)
{
  size_t done = 0;
  while (done < bytes.size())
  {
    wait(POLLOUT);
    const ssize_t count = send(socket_.get(), bytes.data() + done, bytes.size() - done, MSG_NOSIGNAL);
    if (count < 0 && errno != EAGAIN && errno != EINTR)
    {
      throw std::runtime_error(name_ + ": " + std::strerror(errno));
    }
    done += static_cast<size_t>(std::max<ssize_t>(count, 0));
  }
}

/// "" at the end.
std::string Peer::readSome(size_t most)
{
  std::string bytes(std::min<size_t>(most, 65536), '\0');
  while (true)
  {
    wait(POLLIN);
    const ssize_t count = recv(socket_.get(), bytes.data(), bytes.size(), 0);
    if (count >= 0)
    {
      bytes.resize(static_cast<size_t>(count));
      return bytes;
    }
    if (errno != EAGAIN && errno != EINTR)
    {
      throw std::runtime_error(name_ + ": " + std::strerror(errno));
    }
  }
}

std::string Peer::read(size_t bytes)
{
  std::string result;
  while (result.size() < bytes)
  {
    const std::string some = readSome(bytes - result.size());
    if (some.empty())
    {
      throw std::runtime_error(name_ + " ended the connection");
    }
    result += some;
  }
  return result;
}

std::string Peer::readBlock(size_t most)
{
  const size_t length = readUint32(read(4).data());
  if (length > most)
  {
    throw std::runtime_error(name_ + " announces " + std::to_string(length) + " bytes");
  }
  return read(length);
}

std::string Peer::readAll(size_t most)
{
  std::string result;
  while (true)
  {
    const std::string some = readSome(65536);
    if (some.empty())
    {
      return result;
    }
    result += some;
    if (result.size() > most)
    {
      throw std::runtime_error(name_ + " sends more than " + std::to_string(most) + " bytes");
    }
  }
}

std::pair<std::string, uint16_t> addressOf(const std::string& uri)
{
  const size_t scheme = uri.find("://");
  const size_t colon = uri.find(':', scheme == std::string::npos ? 0 : scheme + 3);
  const int port = colon == std::string::npos ? 0 : std::atoi(uri.c_str() + colon + 1);
  if (scheme == std::string::npos || colon == std::string::npos || port < 1 || port > 65535)
  {
    throw std::runtime_error("\"" + uri + "\" is no address");
  }
  return {uri.substr(scheme + 3, colon - scheme - 3), static_cast<uint16_t>(port)};
}

std::string encodeHeader(const HeaderFields& fields)
{
  std::string body;
  for (const auto& [name, value] : fields)
  {
    appendUint32(static_cast<uint32_t>(name.size() + 1 + value.size()), &body);
    body += name + "=" + value;
  }
  std::string bytes;
  appendUint32(static_cast<uint32_t>(body.size()), &bytes);
  return bytes + body;
}

HeaderFields decodeHeader(const std::string& bytes)
{
  HeaderFields fields;
  for (size_t at = 0; at + 4 <= bytes.size();)
  {
    const size_t length = readUint32(bytes.data() + at);
    const std::string field = length <= bytes.size() - at - 4 ? bytes.substr(at + 4, length) : "";
    const size_t equals = field.find('=');
    if (equals == std::string::npos)
    {
      throw std::runtime_error("a header of TCPROS with a field that is none");
    }
    fields[field.substr(0, equals)] = field.substr(equals + 1);
    at += 4 + length;
  }
  return fields;
}

}  // namespace pi_web
