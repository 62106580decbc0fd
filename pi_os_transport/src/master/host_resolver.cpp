#include "master/host_resolver.h"

#include <netdb.h>
#include <netinet/in.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{
namespace
{

constexpr std::chrono::seconds KEPT{30};
constexpr std::chrono::seconds UNKNOWN_KEPT{2};
constexpr size_t MOST_KNOWN = 1000;

SocketAddress lookUp(const std::string& host, int flags)
{
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = flags;
  addrinfo* found = nullptr;
  SocketAddress address;
  if (getaddrinfo(host.c_str(), nullptr, &hints, &found) != 0)
  {
    return address;
  }
  // IPv4 first: nodes listen on it unless they were told otherwise.
  const addrinfo* chosen = found;
  for (const addrinfo* one = found; one != nullptr; one = one->ai_next)
  {
    if (one->ai_family == AF_INET)
    {
      chosen = one;
      break;
    }
  }
  std::memcpy(&address.storage, chosen->ai_addr, chosen->ai_addrlen);
  address.size = chosen->ai_addrlen;
  freeaddrinfo(found);
  return address;
}

SocketAddress withPort(SocketAddress address, uint16_t port)
{
  if (address.storage.ss_family == AF_INET)
  {
    reinterpret_cast<sockaddr_in*>(&address.storage)->sin_port = htons(port);
  }
  else if (address.storage.ss_family == AF_INET6)
  {
    reinterpret_cast<sockaddr_in6*>(&address.storage)->sin6_port = htons(port);
  }
  return address;
}

}  // namespace

struct HostResolver::Answers
{
  std::mutex mutex;
  std::vector<std::pair<std::string, SocketAddress>> found;
  FileDescriptor ready{eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)};
};

HostResolver::HostResolver(EventLoop* loop) : loop_(loop), answers_(std::make_shared<Answers>())
{
  if (!answers_->ready)
  {
    throw std::system_error(errno, std::generic_category(), "no eventfd to find hosts with");
  }
  loop_->add(answers_->ready.get(), EPOLLIN, [this](uint32_t) { takeAnswers(); });
}

HostResolver::~HostResolver()
{
  loop_->remove(answers_->ready.get());
}

void HostResolver::resolve(const std::string& host, uint16_t port, Resolved resolved)
{
  const SocketAddress numeric = lookUp(host == "localhost" ? "127.0.0.1" : host, AI_NUMERICHOST);
  if (numeric.size != 0)
  {
    resolved(withPort(numeric, port));
    return;
  }
  const auto known = known_.find(host);
  if (known != known_.end() && known->second.until > SteadyClock::now())
  {
    resolved(withPort(known->second.address, port));
    return;
  }
  std::vector<Waiting>& waiting = waiting_[host];
  waiting.push_back({port, std::move(resolved)});
  if (waiting.size() == 1)
  {
    queue_.push_back(host);
    startThreads();
  }
}

void HostResolver::startThreads()
{
  while (threads_ < MOST_THREADS && !queue_.empty())
  {
    const auto ask = [answers = answers_, host = queue_.front()]
    {
      const SocketAddress address = lookUp(host, AI_ADDRCONFIG);
      const std::lock_guard<std::mutex> lock(answers->mutex);
      answers->found.emplace_back(host, address);
      const uint64_t one = 1;
      // The counter cannot be full: it is read before so many answers are there.
      [[maybe_unused]] const ssize_t written = write(answers->ready.get(), &one, sizeof(one));
    };
    try
    {
      std::thread(ask).detach();
    }
    catch (const std::system_error&)
    {
      if (threads_ == 0)
      {
        ask();  // no thread is to be had: better late than never
        ++threads_;
        queue_.pop_front();
      }
      return;
    }
    ++threads_;
    queue_.pop_front();
  }
}

void HostResolver::takeAnswers()
{
  uint64_t count = 0;
  [[maybe_unused]] const ssize_t size = read(answers_->ready.get(), &count, sizeof(count));
  std::vector<std::pair<std::string, SocketAddress>> found;
  {
    const std::lock_guard<std::mutex> lock(answers_->mutex);
    found.swap(answers_->found);
  }
  threads_ -= static_cast<int>(found.size());
  if (known_.size() > MOST_KNOWN)
  {
    known_.clear();
  }
  for (const auto& [host, address] : found)
  {
    known_[host] = {address, SteadyClock::now() + (address.size != 0 ? KEPT : UNKNOWN_KEPT)};
    for (const Waiting& one : std::exchange(waiting_[host], {}))
    {
      one.resolved(withPort(address, one.port));
    }
    waiting_.erase(host);
  }
  startThreads();
}

}  // namespace pi_os_transport
