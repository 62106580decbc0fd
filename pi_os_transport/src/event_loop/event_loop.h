#pragma once

#include <sys/epoll.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

using SteadyClock = std::chrono::steady_clock;
using SteadyTime = SteadyClock::time_point;

/// Waits for descriptors and timers on one thread and runs their callbacks. Not thread safe, except stop().
class EventLoop
{
public:
  using Ready = std::function<void(uint32_t events)>;
  using TimerId = uint64_t;  ///< never 0

  EventLoop();

  /// Calls `ready` when one of `events` (EPOLLIN, EPOLLOUT) occurs; EPOLLHUP and EPOLLERR are always reported.
  void add(int fd, uint32_t events, Ready ready);
  void change(int fd, uint32_t events);
  /// May be called inside any callback. Must be called before the descriptor is closed.
  void remove(int fd);

  /// Calls `due` once.
  TimerId at(SteadyTime time, std::function<void()> due);
  void cancel(TimerId timer);

  /// Calls `action` after the callbacks of this round, before waiting again.
  void defer(std::function<void()> action);

  /// The next event is expected within `time`: the loop polls instead of sleeping, because waking up costs more. Each
  /// call replaces the last one; zero ends the polling.
  void expectSoon(std::chrono::microseconds time)
  {
    awake_until_ = time.count() > 0 ? SteadyClock::now() + time : SteadyTime();
  }

  /// Runs until stop() is called.
  void run();
  /// Runs one round: waits at most `timeout`, runs what is due. For tests.
  void runOnce(std::chrono::milliseconds timeout);
  /// May be called by any thread and by signal handlers.
  void stop();

private:
  struct Watch
  {
    uint64_t serial;
    Ready ready;
  };
  int waitMilliseconds(std::chrono::milliseconds longest) const;
  void callDueTimers();
  void callDeferred();

  FileDescriptor epoll_;
  FileDescriptor stop_event_;
  bool stopped_ = false;
  uint64_t next_serial_ = 1;
  SteadyTime awake_until_;
  std::unordered_map<int, std::shared_ptr<Watch>> watches_;
  std::map<std::pair<SteadyTime, TimerId>, std::function<void()>> timers_;
  std::unordered_map<TimerId, SteadyTime> timer_times_;
  std::vector<std::function<void()>> deferred_;
};

/// One call in the future. Starting again, stop() and the destructor cancel it. The loop must outlive this object.
class Timer
{
public:
  Timer() = default;
  ~Timer() { stop(); }
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

  void start(EventLoop* loop, SteadyTime time, std::function<void()> due);
  void start(EventLoop* loop, std::chrono::milliseconds delay, std::function<void()> due)
  {
    start(loop, SteadyClock::now() + delay, std::move(due));
  }
  void stop();
  /// True if the call is still to come.
  bool running() const { return id_ != 0; }

private:
  EventLoop* loop_ = nullptr;
  EventLoop::TimerId id_ = 0;
};

}  // namespace pi_os_transport
