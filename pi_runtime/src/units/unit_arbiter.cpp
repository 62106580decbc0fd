#include "units/unit_arbiter.h"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <stdexcept>
#include <tuple>

namespace pi_runtime
{
namespace
{

using std::chrono::steady_clock;

constexpr uint64_t PLACE_MASK = 0xff;
constexpr uint64_t WAITERS = 1 << 8;
constexpr uint64_t GRANTED = 1 << 9;
constexpr unsigned SERIAL_SHIFT = 16;

int64_t placeOf(uint64_t holder)
{
  return static_cast<int64_t>(holder & PLACE_MASK) - 1;
}

uint64_t serialOf(uint64_t holder)
{
  return holder >> SERIAL_SHIFT;
}

/// The value that follows `seen`. @param place new holder, -1: none.
uint64_t successor(uint64_t seen, int64_t place, uint64_t flags)
{
  return (serialOf(seen) + 1) << SERIAL_SHIFT | flags | static_cast<uint64_t>(place + 1);
}

bool isWaiting(uint32_t waiting)
{
  return waiting % 2 == 1;
}

void futexWait(std::atomic<uint32_t>& word, uint32_t expected, std::chrono::nanoseconds timeout)
{
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(timeout);
  const timespec limit{static_cast<time_t>(seconds.count()), static_cast<long>((timeout - seconds).count())};
  syscall(SYS_futex, reinterpret_cast<uint32_t*>(&word), FUTEX_WAIT, expected, &limit, nullptr, 0);
}

void wakeWaiter(UnitTable::Place& place)
{
  place.wake.fetch_add(1, std::memory_order_release);
  syscall(SYS_futex, reinterpret_cast<uint32_t*>(&place.wake), FUTEX_WAKE, 1, nullptr, nullptr, 0);
}

}  // namespace

UnitArbiter::UnitArbiter(const std::string& key, const std::string& folder) : file_(key, folder)
{
  setBlockingBudget(NO_BUDGET);
  setStreams({});
  // The last user of the place may have been killed as a waiter, just now be handed the unit, or have held it.
  withdraw();
  if (held())
  {
    release();
  }
}

UnitArbiter::~UnitArbiter()
{
  if (!file_.isForked() && held())
  {
    release();
  }
}

bool UnitArbiter::tryAcquire()
{
  UnitTable& table = file_.table();
  uint64_t seen = table.holder.load(std::memory_order_relaxed);
  return placeOf(seen) < 0 &&
         table.holder.compare_exchange_strong(seen, successor(seen, file_.ownPlace(), 0), std::memory_order_acq_rel,
                                              std::memory_order_relaxed);
}

bool UnitArbiter::acquire(int64_t deadline_ns, int priority, std::chrono::nanoseconds timeout)
{
  UnitTable::Place& own = ownPlace();
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (waiting_)
    {
      throw std::logic_error(path() +
                             ": acquire() was called while another thread waits in it; use one thread per unit");
    }
    waiting_ = true;
    own.deadline_ns.store(deadline_ns, std::memory_order_relaxed);
    own.priority.store(priority, std::memory_order_relaxed);
  }
  const auto now = steady_clock::now();
  const auto until = timeout < steady_clock::time_point::max() - now ? now + timeout : steady_clock::time_point::max();
  const bool acquired = !cancelled_.load(std::memory_order_acquire) && (enterQueue() || waitForUnit(until));
  const std::lock_guard<std::mutex> lock(mutex_);
  waiting_ = false;
  cancelled_.store(false, std::memory_order_relaxed);
  return acquired;
}

/// Takes the unit if it is free (returns true), else makes this process one of its waiters.
bool UnitArbiter::enterQueue()
{
  UnitTable::Place& own = ownPlace();
  uint64_t seen = file_.table().holder.load(std::memory_order_acquire);
  for (;;)
  {
    if (takeIfGranted(seen))  // a releasing holder saw the wait before it was announced below
    {
      return true;
    }
    if (placeOf(seen) < 0)
    {
      if (file_.table().holder.compare_exchange_weak(seen, successor(seen, file_.ownPlace(), 0),
                                                     std::memory_order_acq_rel, std::memory_order_acquire))
      {
        stopWaiting();
        return true;
      }
      continue;
    }
    own.arrival.store(serialOf(seen) + 1, std::memory_order_relaxed);
    if (!isWaiting(own.waiting.load(std::memory_order_relaxed)))
    {
      own.waiting.fetch_add(1, std::memory_order_release);
    }
    const uint64_t announced = successor(seen, placeOf(seen), (seen & GRANTED) | WAITERS);
    if (file_.table().holder.compare_exchange_weak(seen, announced, std::memory_order_acq_rel,
                                                   std::memory_order_acquire))
    {
      return false;
    }
  }
}

bool UnitArbiter::waitForUnit(steady_clock::time_point until)
{
  for (;;)
  {
    const uint32_t wake = ownPlace().wake.load(std::memory_order_acquire);
    const uint64_t seen = file_.table().holder.load(std::memory_order_acquire);
    if (takeIfGranted(seen))
    {
      return true;
    }
    const auto now = steady_clock::now();
    if (cancelled_.load(std::memory_order_acquire) || now >= until)
    {
      return !withdraw();
    }
    if (!file_.isAlive(static_cast<uint32_t>(placeOf(seen))))
    {
      tryHandOver(seen);
      continue;
    }
    futexWait(ownPlace().wake, wake, std::min<std::chrono::nanoseconds>(until - now, CHECK_INTERVAL));
  }
}

/// Leaves the queue. @return false if the unit came at the same moment.
bool UnitArbiter::withdraw()
{
  stopWaiting();
  uint64_t seen = file_.table().holder.load(std::memory_order_acquire);
  for (;;)
  {
    if (takeIfGranted(seen))
    {
      return false;
    }
    if (placeOf(seen) < 0)
    {
      return true;
    }
    size_t waiters = 0;
    bestWaiter(&waiters);
    const uint64_t left = successor(seen, placeOf(seen), (seen & GRANTED) | (waiters > 0 ? WAITERS : 0));
    // The serial number changes, so a process that is handing the unit to this place decides again.
    if (file_.table().holder.compare_exchange_weak(seen, left, std::memory_order_acq_rel, std::memory_order_acquire))
    {
      return true;
    }
  }
}

/// Takes note that the unit was handed to this process's waiter, if it was.
bool UnitArbiter::takeIfGranted(uint64_t seen)
{
  if (placeOf(seen) != file_.ownPlace() || (seen & GRANTED) == 0)
  {
    return false;
  }
  stopWaiting();
  while (!file_.table().holder.compare_exchange_weak(seen, successor(seen, file_.ownPlace(), seen & WAITERS),
                                                     std::memory_order_acq_rel, std::memory_order_acquire))
  {
  }
  return true;
}

void UnitArbiter::stopWaiting()
{
  uint32_t waiting = ownPlace().waiting.load(std::memory_order_relaxed);
  if (isWaiting(waiting))
  {
    // Fails only at a start, against somebody who strikes out the dead user of this place: with the same result.
    ownPlace().waiting.compare_exchange_strong(waiting, waiting + 1, std::memory_order_acq_rel);
  }
}

/// @return the place of the next holder, -1 if no place waits. @param waiters  set to their number.
int UnitArbiter::bestWaiter(size_t* waiters) const
{
  const UnitTable& table = file_.table();
  const auto rank = [&table](int place)
  {
    const UnitTable::Place& waiter = table.place[place];
    return std::make_tuple(waiter.deadline_ns.load(std::memory_order_relaxed),
                           -int64_t{waiter.priority.load(std::memory_order_relaxed)},
                           waiter.arrival.load(std::memory_order_relaxed));
  };
  int best = -1;
  *waiters = 0;
  for (int place = 0; place < static_cast<int>(UnitTable::PLACES); ++place)
  {
    if (isWaiting(table.place[place].waiting.load(std::memory_order_acquire)))
    {
      ++*waiters;
      best = best < 0 || rank(place) < rank(best) ? place : best;
    }
  }
  return best;
}

/// Passes the unit from its holder, which is this object or dead, to the best living waiter, or frees it.
/// @param seen  value of `holder` for which the caller knows that.
/// @return false if `holder` has changed since; nothing was done then.
bool UnitArbiter::tryHandOver(uint64_t seen)
{
  for (;;)
  {
    size_t waiters = 0;
    const int best = bestWaiter(&waiters);
    if (best < 0)
    {
      return file_.table().holder.compare_exchange_strong(seen, successor(seen, -1, 0), std::memory_order_acq_rel);
    }
    UnitTable::Place& winner = file_.table().place[best];
    uint32_t waiting = winner.waiting.load(std::memory_order_acquire);
    if (!file_.isAlive(static_cast<uint32_t>(best)))
    {
      if (isWaiting(waiting))  // not, if the place has a new user that tidied up; a change by it defeats the exchange
      {
        winner.waiting.compare_exchange_strong(waiting, waiting + 1, std::memory_order_acq_rel);
      }
      continue;
    }
    const uint64_t next = successor(seen, best, GRANTED | (waiters > 1 ? WAITERS : 0));
    if (!file_.table().holder.compare_exchange_strong(seen, next, std::memory_order_acq_rel))
    {
      return false;
    }
    wakeWaiter(winner);
    return true;
  }
}

bool UnitArbiter::updateWaiting(int64_t deadline_ns, int priority)
{
  UnitTable::Place& own = ownPlace();
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!waiting_)
  {
    return false;
  }
  own.deadline_ns.store(deadline_ns, std::memory_order_relaxed);
  own.priority.store(priority, std::memory_order_relaxed);
  return true;
}

void UnitArbiter::cancelWait()
{
  UnitTable::Place& own = ownPlace();
  cancelled_.store(true, std::memory_order_release);
  wakeWaiter(own);
}

void UnitArbiter::release()
{
  UnitTable& table = file_.table();
  for (bool done = false; !done;)
  {
    uint64_t seen = table.holder.load(std::memory_order_acquire);
    if (placeOf(seen) != file_.ownPlace() || (seen & GRANTED) != 0)
    {
      throw std::logic_error(path() + ": release() was called without holding the unit; acquire it first");
    }
    done = (seen & WAITERS) != 0
               ? tryHandOver(seen)
               : table.holder.compare_exchange_strong(seen, successor(seen, -1, 0), std::memory_order_acq_rel);
  }
}

bool UnitArbiter::held() const
{
  const uint64_t seen = file_.table().holder.load(std::memory_order_acquire);
  return placeOf(seen) == file_.ownPlace() && (seen & GRANTED) == 0;
}

bool UnitArbiter::contended() const
{
  return waiters() > 0;
}

size_t UnitArbiter::waiters() const
{
  const UnitTable& table = file_.table();
  size_t others = 0;
  if ((table.holder.load(std::memory_order_acquire) & WAITERS) != 0)
  {
    for (uint32_t place = 0; place < UnitTable::PLACES; ++place)
    {
      others += place != file_.ownPlace() && isWaiting(table.place[place].waiting.load(std::memory_order_acquire));
    }
  }
  return others;
}

int64_t UnitArbiter::nextDeadline() const
{
  const UnitTable& table = file_.table();
  int64_t earliest_ns = NO_DEADLINE;
  if ((table.holder.load(std::memory_order_acquire) & WAITERS) != 0)
  {
    for (uint32_t place = 0; place < UnitTable::PLACES; ++place)
    {
      const UnitTable::Place& other = table.place[place];
      const bool waits = place != file_.ownPlace() && isWaiting(other.waiting.load(std::memory_order_acquire));
      const int64_t deadline_ns = other.deadline_ns.load(std::memory_order_relaxed);
      earliest_ns = waits && deadline_ns < earliest_ns && file_.isAlive(place) ? deadline_ns : earliest_ns;
    }
  }
  return earliest_ns;
}

void UnitArbiter::setStreams(const std::vector<SharedStream>& streams)
{
  UnitTable::Place& own = ownPlace();
  const size_t count = std::min(streams.size(), UnitTable::MOST_STREAMS);
  // A sequence lock: odd while it is written, also after a user of the place was killed in between.
  const uint32_t odd = own.streams_version.load(std::memory_order_relaxed) | 1U;
  own.streams_version.store(odd, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  for (size_t stream = 0; stream < count; ++stream)
  {
    std::array<uint64_t, SharedStream::WORDS> words;
    std::memcpy(words.data(), &streams[stream], sizeof words);
    for (size_t word = 0; word < words.size(); ++word)
    {
      own.streams[stream][word].store(words[word], std::memory_order_relaxed);
    }
  }
  own.stream_count.store(static_cast<uint32_t>(count), std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  own.streams_version.store(odd + 1, std::memory_order_release);
  // Two processes that look at the other's streams after this: at least one of them sees both.
  std::atomic_thread_fence(std::memory_order_seq_cst);
}

std::vector<UnitArbiter::OthersStream> UnitArbiter::othersStreams() const
{
  constexpr int MOST_TRIES = 1000;
  const UnitTable& table = file_.table();
  std::vector<OthersStream> result;
  for (uint32_t index = 0; index < UnitTable::PLACES; ++index)
  {
    const UnitTable::Place& place = table.place[index];
    if (index == file_.ownPlace() || place.stream_count.load(std::memory_order_relaxed) == 0 || !file_.isAlive(index))
    {
      continue;
    }
    std::vector<OthersStream> streams;
    for (int tries = 0; tries < MOST_TRIES; ++tries)
    {
      streams.clear();
      const uint32_t version = place.streams_version.load(std::memory_order_acquire);
      const size_t count =
          std::min<size_t>(place.stream_count.load(std::memory_order_relaxed), UnitTable::MOST_STREAMS);
      for (size_t stream = 0; stream < count; ++stream)
      {
        std::array<uint64_t, SharedStream::WORDS> words;
        for (size_t word = 0; word < words.size(); ++word)
        {
          words[word] = place.streams[stream][word].load(std::memory_order_relaxed);
        }
        streams.push_back({place.pid.load(std::memory_order_relaxed), {}});
        std::memcpy(static_cast<void*>(&streams.back().stream), words.data(), sizeof words);
        streams.back().stream.name[sizeof(SharedStream::name) - 1] = '\0';
      }
      std::atomic_thread_fence(std::memory_order_acquire);
      if (version % 2 == 0 && place.streams_version.load(std::memory_order_relaxed) == version)
      {
        break;
      }
    }
    result.insert(result.end(), streams.begin(), streams.end());
  }
  return result;
}

void UnitArbiter::setBlockingBudget(int64_t budget_ns)
{
  ownPlace().blocking_budget_ns.store(budget_ns, std::memory_order_relaxed);
}

int64_t UnitArbiter::blockingBudget() const
{
  const UnitTable& table = file_.table();
  int64_t smallest_ns = NO_BUDGET;
  for (uint32_t place = 0; place < UnitTable::PLACES; ++place)
  {
    const int64_t budget_ns = table.place[place].blocking_budget_ns.load(std::memory_order_relaxed);
    const bool counts = place != file_.ownPlace() && budget_ns < smallest_ns && file_.isAlive(place);
    smallest_ns = counts ? budget_ns : smallest_ns;
  }
  return smallest_ns;
}

}  // namespace pi_runtime
