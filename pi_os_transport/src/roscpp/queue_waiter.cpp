#include "roscpp/queue_waiter.h"

#include <sys/epoll.h>

#include <algorithm>
#include <chrono>
#include <shared_mutex>
#include <unordered_map>

#include "shm/event.h"

namespace pi_os_transport
{
namespace
{

/// A leader visits every link at each wake-up. With more links than this, the network thread is faster.
constexpr size_t MAX_LINKS = 32;

struct Table
{
  static Table& instance()
  {
    static Table* table = new Table;
    return *table;
  }
  std::shared_mutex mutex;
  std::unordered_map<const ros::CallbackQueue*, std::shared_ptr<QueueWaiter>> waiters;
  std::atomic<bool> any{false};
};

bool isIdle(ros::CallbackQueue* queue)
{
  boost::mutex::scoped_lock lock(queue->mutex_);
  return queue->callbacks_.empty() && queue->enabled_;
}

}  // namespace

std::shared_ptr<QueueWaiter> QueueWaiter::find(const ros::CallbackQueue* queue)
{
  Table& table = Table::instance();
  if (!table.any.load(std::memory_order_acquire))
  {
    return nullptr;
  }
  std::shared_lock<std::shared_mutex> lock(table.mutex);
  const auto found = table.waiters.find(queue);
  return found != table.waiters.end() ? found->second : nullptr;
}

std::shared_ptr<QueueWaiter> QueueWaiter::of(ros::CallbackQueue* queue)
{
  Table& table = Table::instance();
  std::unique_lock<std::shared_mutex> lock(table.mutex);
  for (auto entry = table.waiters.begin(); entry != table.waiters.end();)
  {
    std::unique_lock<std::mutex> links_lock(entry->second->mutex_);
    const bool unused = entry->first != queue && entry->second->links_.empty() && entry->second.use_count() == 1;
    links_lock.unlock();
    entry = unused ? table.waiters.erase(entry) : std::next(entry);
  }
  std::shared_ptr<QueueWaiter>& waiter = table.waiters[queue];
  if (!waiter)
  {
    waiter = std::make_shared<QueueWaiter>();
  }
  table.any.store(true, std::memory_order_release);
  return waiter;
}

QueueWaiter::QueueWaiter() : epoll_(epoll_create1(EPOLL_CLOEXEC)), changed_(makeEvent())
{
  epoll_event event{};
  event.events = EPOLLIN | EPOLLET;  // edge-triggered: the counters need not be read
  epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, changed_.get(), &event);
}

void QueueWaiter::add(const std::shared_ptr<QueueSource>& link, int doorbell)
{
  epoll_event event{};
  event.events = EPOLLIN | EPOLLET;
  if (epoll_ctl(epoll_.get(), EPOLL_CTL_ADD, doorbell, &event) == 0)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    links_.push_back(link);
  }
  notify();
}

void QueueWaiter::remove(const std::shared_ptr<QueueSource>& link, int doorbell)
{
  epoll_ctl(epoll_.get(), EPOLL_CTL_DEL, doorbell, nullptr);
  std::lock_guard<std::mutex> lock(mutex_);
  links_.erase(std::remove(links_.begin(), links_.end(), link), links_.end());
  notify();  // the leader's reference keeps the publisher's memory
}

void QueueWaiter::notify()
{
  if (sleeping_.load(std::memory_order_seq_cst))
  {
    signalEvent(changed_.get());
  }
}

void QueueWaiter::serveAll(Doorbell doorbell)
{
  for (const std::shared_ptr<QueueSource>& link : serving_)
  {
    link->serve(doorbell);
  }
}

/// Cleans up behind the leader, also if roscpp throws.
struct QueueWaiter::Lead
{
  QueueWaiter& waiter;

  ~Lead()
  {
    waiter.sleeping_.store(false, std::memory_order_seq_cst);
    waiter.serving_.clear();
    waiter.led_.store(false, std::memory_order_release);
  }
};

bool QueueWaiter::wait(ros::CallbackQueue* queue, ros::WallDuration timeout)
{
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds SHORTEST(1);  // the resolution of epoll_wait()
  const std::chrono::nanoseconds span(timeout.toNSec());
  if (span < SHORTEST || !epoll_ || !changed_ || led_.exchange(true))
  {
    return false;
  }
  const Lead lead{*this};
  const Clock::time_point end = Clock::now() + span;
  bool waited = false;
  while (isIdle(queue) && Clock::now() < end)
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      serving_ = links_;
    }
    if (serving_.empty() || serving_.size() > MAX_LINKS)
    {
      break;
    }
    waited = true;
    serveAll(SPINNER);
    sleeping_.store(true, std::memory_order_seq_cst);
    // A thread that adds a callback after this check sees sleeping_.
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now());
    if (isIdle(queue) && left.count() > 0)
    {
      epoll_event event;
      epoll_wait(epoll_.get(), &event, 1, static_cast<int>(std::min<int64_t>(left.count(), INT32_MAX)));
    }
    sleeping_.store(false, std::memory_order_seq_cst);
    serveAll(NETWORK_THREAD);
  }
  return waited;
}

}  // namespace pi_os_transport
