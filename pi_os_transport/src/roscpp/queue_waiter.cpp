#include "roscpp/queue_waiter.h"

#include <chrono>
#include <shared_mutex>
#include <unordered_map>

#include "shm/futex.h"

namespace pi_os_transport
{
namespace
{

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
    const bool unused = entry->first != queue && entry->second->links_ == 0 && entry->second.use_count() == 1;
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

QueueWaiter::QueueWaiter() : doorbell_(Runtime::instance().takeSleeper()) {}

QueueWaiter::~QueueWaiter()
{
  if (doorbell_ != 0)
  {
    Runtime::instance().giveSleeper(doorbell_);
  }
}

uint32_t QueueWaiter::join()
{
  ++links_;
  notify();
  return doorbell_ != 0 ? doorbell_ : NETWORK_THREAD;
}

void QueueWaiter::leave()
{
  --links_;
}

void QueueWaiter::notify()
{
  const Runtime& runtime = Runtime::instance();
  std::atomic<uint32_t>* const word = doorbell_ != 0 && runtime.active() ? runtime.sleeper(doorbell_).ring() : nullptr;
  if (word != nullptr)
  {
    futexWake(word);
  }
}

/// Cleans up behind the leader, also if roscpp throws.
struct QueueWaiter::Lead
{
  QueueWaiter& waiter;

  ~Lead() { waiter.led_.store(false, std::memory_order_release); }
};

bool QueueWaiter::wait(ros::CallbackQueue* queue, ros::WallDuration timeout)
{
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds SHORTEST(1);  // less is a question, not a wait
  const std::chrono::nanoseconds span(timeout.toNSec());
  if (span < SHORTEST || doorbell_ == 0 || links_ == 0 || led_.exchange(true))
  {
    return false;
  }
  const Lead lead{*this};
  Runtime& runtime = Runtime::instance();
  Sleeper sleeper = runtime.sleeper(doorbell_);
  const Clock::time_point end = Clock::now() + span;
  runtime.serveNews();
  while (isIdle(queue) && links_ != 0)
  {
    const uint32_t bell = sleeper.prepare();
    // Who writes a message or adds a callback after these looks sees that this thread sleeps.
    const std::chrono::nanoseconds left = end - Clock::now();
    if (!runtime.hasNews() && isIdle(queue) && left.count() > 0)
    {
      futexWait(sleeper.word(), bell, left);
    }
    sleeper.wakeUp();
    runtime.serveNews();  // also what came while this thread passed for asleep
    if (left.count() <= 0)
    {
      break;
    }
  }
  return true;
}

}  // namespace pi_os_transport
