#include "event_loop/event_loop.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

#include "shm/event.h"

namespace pi_os_transport
{
namespace
{

constexpr int EVENTS_PER_ROUND = 64;
constexpr std::chrono::milliseconds FOR_EVER{60000};

[[noreturn]] void fail(const char* what)
{
  throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

EventLoop::EventLoop() : epoll_(epoll_create1(EPOLL_CLOEXEC)), stop_event_(makeEvent())
{
  if (!epoll_ || !stop_event_)
  {
    fail("event loop");
  }
  add(stop_event_.get(), EPOLLIN, [this](uint32_t) { stopped_ = true; });
}

void EventLoop::add(int fd, uint32_t events, Ready ready)
{
  auto watch = std::make_shared<Watch>(Watch{next_serial_++, std::move(ready)});
  epoll_event event{};
  event.events = events;
  // The serial distinguishes a removed descriptor from its successor with the same number.
  event.data.u64 = watch->serial << 32 | static_cast<uint32_t>(fd);
  if (epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, fd, &event) != 0)
  {
    fail("epoll_ctl");
  }
  watches_[fd] = std::move(watch);
}

void EventLoop::change(int fd, uint32_t events)
{
  const auto found = watches_.find(fd);
  if (found == watches_.end())
  {
    return;
  }
  epoll_event event{};
  event.events = events;
  event.data.u64 = found->second->serial << 32 | static_cast<uint32_t>(fd);
  epoll_ctl(epoll_.get(), EPOLL_CTL_MOD, fd, &event);
}

void EventLoop::remove(int fd)
{
  if (watches_.erase(fd) != 0)
  {
    epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, fd, nullptr);
  }
}

EventLoop::TimerId EventLoop::at(SteadyTime time, std::function<void()> due)
{
  const TimerId id = next_serial_++;
  timers_.emplace(std::make_pair(time, id), std::move(due));
  timer_times_[id] = time;
  return id;
}

void EventLoop::cancel(TimerId timer)
{
  const auto found = timer_times_.find(timer);
  if (found != timer_times_.end())
  {
    timers_.erase({found->second, timer});
    timer_times_.erase(found);
  }
}

void EventLoop::defer(std::function<void()> action)
{
  deferred_.push_back(std::move(action));
}

int EventLoop::waitMilliseconds(std::chrono::milliseconds longest) const
{
  if (!deferred_.empty())
  {
    return 0;
  }
  auto wait = longest;
  if (!timers_.empty())
  {
    const auto until = std::chrono::ceil<std::chrono::milliseconds>(timers_.begin()->first.first - SteadyClock::now());
    wait = std::clamp(until, std::chrono::milliseconds(0), longest);
  }
  return static_cast<int>(wait.count());
}

void EventLoop::callDueTimers()
{
  const SteadyTime now = SteadyClock::now();
  while (!timers_.empty() && timers_.begin()->first.first <= now)
  {
    auto due = timers_.extract(timers_.begin());
    timer_times_.erase(due.key().second);
    due.mapped()();
  }
}

void EventLoop::callDeferred()
{
  for (const std::function<void()>& action : std::exchange(deferred_, {}))
  {
    action();
  }
}

void EventLoop::runOnce(std::chrono::milliseconds timeout)
{
  std::array<epoll_event, EVENTS_PER_ROUND> events;
  int count = 0;
  while (awake_until_ != SteadyTime() && count == 0)
  {
    count = epoll_wait(epoll_.get(), events.data(), EVENTS_PER_ROUND, 0);
    if (SteadyClock::now() >= awake_until_)
    {
      awake_until_ = SteadyTime();
    }
  }
  if (count == 0)
  {
    count = epoll_wait(epoll_.get(), events.data(), EVENTS_PER_ROUND, waitMilliseconds(timeout));
  }
  if (count < 0 && errno != EINTR)
  {
    fail("epoll_wait");
  }
  for (int index = 0; index < count; ++index)
  {
    const uint64_t key = events[static_cast<size_t>(index)].data.u64;
    const auto found = watches_.find(static_cast<int>(key & 0xffffffff));
    if (found != watches_.end() && (found->second->serial & 0xffffffff) == key >> 32)
    {
      const std::shared_ptr<Watch> watch = found->second;  // the callback may remove the watch
      watch->ready(events[static_cast<size_t>(index)].events);
    }
  }
  callDueTimers();
  callDeferred();
}

void EventLoop::run()
{
  while (!stopped_)
  {
    runOnce(FOR_EVER);
  }
}

void EventLoop::stop()
{
  signalEvent(stop_event_.get());
}

void Timer::start(EventLoop* loop, SteadyTime time, std::function<void()> due)
{
  stop();
  loop_ = loop;
  id_ = loop->at(time,
                 [this, due = std::move(due)]
                 {
                   id_ = 0;
                   due();  // may destroy this object
                 });
}

void Timer::stop()
{
  if (id_ != 0)
  {
    loop_->cancel(std::exchange(id_, 0));
  }
}

}  // namespace pi_os_transport
