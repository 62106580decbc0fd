#include "wire/event_thread.h"
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <exception>

namespace pi_offload
{
namespace
{

using Clock = std::chrono::steady_clock;

constexpr int64_t LONGEST_SLEEP_NS = 3600LL * 1000000000;  ///< keeps instants far away from overflowing

}  // namespace

EventThread::EventThread(const std::string& name, Callbacks callbacks)
  : name_(name.substr(0, 15)), callbacks_(std::move(callbacks))
{
}

EventThread::~EventThread()
{
  stop();
}

void EventThread::start()
{
  thread_ = std::thread([this] { run(); });
}

void EventThread::stop()
{
  std::deque<Function> dropped;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    dropped.swap(functions_);
  }
  changed_.notify_all();
  dropped.clear();  // not under the lock, and before waiting: the function in work may wait for who waits for these
  if (thread_.joinable())
  {
    thread_.join();
  }
}

void EventThread::post(Function function)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_)
    {
      return;
    }
    functions_.push_back(std::move(function));
  }
  changed_.notify_one();
}

void EventThread::run()
{
  pthread_setname_np(pthread_self(), name_.c_str());
  const auto guarded = [this](const Function& function)
  {
    try
    {
      function(monotonicNs());
    }
    catch (const std::exception& error)
    {
      callbacks_.failed(error.what());
    }
  };
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stopping_)
  {
    if (!functions_.empty())
    {
      Function function = std::move(functions_.front());
      functions_.pop_front();
      lock.unlock();
      guarded(function);
      function = nullptr;  // what it holds ends here, not under the lock
      lock.lock();
    }
    lock.unlock();
    const int64_t next_ns = callbacks_.next_time();
    const int64_t now_ns = monotonicNs();
    if (next_ns <= now_ns)
    {
      guarded(callbacks_.on_time);
    }
    lock.lock();
    if (stopping_ || !functions_.empty() || next_ns <= now_ns)
    {
      continue;
    }
    const auto due = [this] { return stopping_ || !functions_.empty(); };
    const std::chrono::nanoseconds sleep(std::min(next_ns - now_ns, LONGEST_SLEEP_NS));
    changed_.wait_until(lock, Clock::time_point(std::chrono::nanoseconds(now_ns) + sleep), due);
  }
}

}  // namespace pi_offload
