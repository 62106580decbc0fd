#include "master/host_resolver.h"

#include <netdb.h>
#include <sys/epoll.h>

#include <cerrno>
#include <chrono>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "shm/event.h"

namespace pi_os_transport
{
namespace
{

constexpr std::chrono::seconds KEPT{30};
constexpr std::chrono::seconds UNKNOWN_KEPT{2};
constexpr size_t MOST_KNOWN = 1000;

}  // namespace

struct HostResolver::Answers
{
  std::mutex mutex;
  std::vector<std::pair<std::string, SocketAddress>> found;
  FileDescriptor ready = makeEvent();
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
  const SocketAddress numeric = findAddress(host == "localhost" ? "127.0.0.1" : host, AI_NUMERICHOST);
  if (numeric.size != 0)
  {
    resolved(numeric.withPort(port));
    return;
  }
  const auto known = known_.find(host);
  if (known != known_.end() && known->second.until > SteadyClock::now())
  {
    resolved(known->second.address.withPort(port));
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
      const SocketAddress address = findAddress(host, AI_ADDRCONFIG);
      const std::lock_guard<std::mutex> lock(answers->mutex);
      answers->found.emplace_back(host, address);
      signalEvent(answers->ready.get());
    };
    try
    {
      std::thread(ask).detach();
    }
    catch (const std::system_error&)
    {
      if (threads_ == 0)
      {
        ask();  // no thread can be started: the loop waits for the answer
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
  clearEvent(answers_->ready.get());
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
      one.resolved(address.withPort(one.port));
    }
    waiting_.erase(host);
  }
  startThreads();
}

}  // namespace pi_os_transport
