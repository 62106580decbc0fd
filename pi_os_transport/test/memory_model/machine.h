#pragma once

#include <ucontext.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "weak_memory.h"

namespace weak_memory
{

constexpr size_t MAX_LOCATIONS = 48;
constexpr size_t MAX_THREADS = 3;
constexpr size_t STACK_BYTES = 64 << 10;

inline bool acquires(std::memory_order order)
{
  return order == std::memory_order_acquire || order == std::memory_order_acq_rel || order == std::memory_order_seq_cst;
}

inline bool releases(std::memory_order order)
{
  return order == std::memory_order_release || order == std::memory_order_acq_rel || order == std::memory_order_seq_cst;
}

inline uint64_t mix(uint64_t value)
{
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9;
  value = (value ^ (value >> 27)) * 0x94d049bb133111eb;
  return value ^ (value >> 31);
}

/// What a thread, or who reads a message, knows: the place in each location's modification order that it may not look
/// behind, and how many plain accesses of each thread happened before.
struct View
{
  std::array<uint8_t, MAX_LOCATIONS> place{};
  std::array<uint8_t, MAX_THREADS> clock{};

  void join(const View& other)
  {
    for (size_t i = 0; i < MAX_LOCATIONS; ++i)
    {
      place[i] = std::max(place[i], other.place[i]);
    }
    for (size_t i = 0; i < MAX_THREADS; ++i)
    {
      clock[i] = std::max(clock[i], other.clock[i]);
    }
  }
};

struct Message
{
  uint64_t value = 0;
  View view;
  bool followed_by_its_change = false;  ///< a read-modify-write has read it: nothing may come between
};

struct Location
{
  const void* address = nullptr;
  uint64_t* raw = nullptr;
  std::vector<Message> messages;
  uint8_t sequential = 0;  ///< what seq_cst operations have seen or written
};

struct PlainLocation
{
  size_t writer = MAX_THREADS;
  uint8_t written = 0;
  std::array<uint8_t, MAX_THREADS> read{};
};

struct Choice
{
  uint32_t taken;
  uint32_t of;
};

/// The memory and the threads of one execution, and the search through all of them.
struct Model::Machine
{
  struct Thread
  {
    ucontext_t context;
    std::vector<char> stack = std::vector<char>(STACK_BYTES);
    Body body;
    View current;
    View after_acquire_fence;
    View at_release_fence;
    bool finished = false;
    std::function<bool()> waits_for;
    uint64_t history = 0;  ///< hash of all values it has seen: with the code it tells where it is
  };

  bool concurrent = false;
  ucontext_t scheduler;
  std::vector<std::unique_ptr<Thread>> threads;
  size_t running = 0;
  std::vector<Location> locations;
  std::unordered_map<const void*, size_t> location_ids;
  std::map<const void*, PlainLocation> plain;
  struct MutexState
  {
    uint8_t held = 0;
    View view;
  };
  std::map<const void*, MutexState> mutexes;
  std::map<const void*, uint8_t> bells;
  std::vector<Choice> trail;
  size_t depth = 0;
  uint64_t steps = 0;
  bool spurious_failure_left = false;
  std::unordered_set<uint64_t> visited;
  std::string failure;
  bool replays = false;  ///< a failure is executed once more, to tell what led there
  std::vector<std::string> log;
  struct KnownSite
  {
    Site site;
    uint64_t* count;
    bool mutated;
  };
  std::map<std::tuple<const char*, const char*, int, std::memory_order>, KnownSite> known_sites;

  Thread& self() { return *threads[running]; }

  uint32_t choose(uint32_t of)
  {
    if (of <= 1)
    {
      return 0;
    }
    if (depth == trail.size())
    {
      trail.push_back(Choice{0, of});
    }
    return trail[depth++].taken;
  }

  /// Moves on to the next leaf. False if all have been seen.
  bool nextExecution()
  {
    while (!trail.empty() && trail.back().taken + 1 == trail.back().of)
    {
      trail.pop_back();
    }
    if (trail.empty())
    {
      return false;
    }
    ++trail.back().taken;
    return true;
  }

  size_t idOf(const void* address, uint64_t* raw)
  {
    const auto [entry, added] = location_ids.emplace(address, locations.size());
    if (added)
    {
      if (locations.size() == MAX_LOCATIONS)
      {
        fail("more than MAX_LOCATIONS locations");
        return 0;
      }
      locations.push_back(Location{address, raw, {Message{*raw, View{}, false}}, 0});
    }
    return entry->second;
  }

  void fail(const std::string& what)
  {
    if (failure.empty())
    {
      failure = what;
    }
  }

  void yieldToScheduler() { swapcontext(&self().context, &scheduler); }

  void observe(uint64_t value) { self().history = mix(self().history * 31 + value + 1); }

  /// Inserts a message at `place`, and moves what every view says about later ones.
  void insert(size_t id, size_t place, Message message)
  {
    const auto shift = [id, place](View* view)
    {
      if (view->place[id] >= place)
      {
        ++view->place[id];
      }
    };
    Location& location = locations[id];
    if (place < location.messages.size())
    {
      for (Location& other : locations)
      {
        for (Message& one : other.messages)
        {
          shift(&one.view);
        }
      }
      for (const std::unique_ptr<Thread>& thread : threads)
      {
        shift(&thread->current);
        shift(&thread->after_acquire_fence);
        shift(&thread->at_release_fence);
      }
      for (auto& [mutex, state] : mutexes)
      {
        shift(&state.view);
      }
      if (location.sequential >= place)
      {
        ++location.sequential;
      }
    }
    location.messages.insert(location.messages.begin() + static_cast<std::ptrdiff_t>(place), std::move(message));
  }

  View viewOfStore(std::memory_order order) { return releases(order) ? self().current : self().at_release_fence; }

  void write(size_t id, size_t place, uint64_t value, std::memory_order order, const View* inherited)
  {
    insert(id, place, Message{value, View{}, false});
    Thread& thread = self();
    thread.current.place[id] = static_cast<uint8_t>(place);
    thread.after_acquire_fence.place[id] = std::max(thread.after_acquire_fence.place[id], static_cast<uint8_t>(place));
    View view = viewOfStore(order);
    view.place[id] = static_cast<uint8_t>(place);
    if (inherited != nullptr)
    {
      view.join(*inherited);
    }
    locations[id].messages[place].view = view;
    if (order == std::memory_order_seq_cst)
    {
      locations[id].sequential = std::max(locations[id].sequential, static_cast<uint8_t>(place));
    }
  }

  void read(size_t id, size_t place, std::memory_order order)
  {
    Thread& thread = self();
    const View view = locations[id].messages[place].view;
    thread.current.place[id] = std::max(thread.current.place[id], static_cast<uint8_t>(place));
    thread.after_acquire_fence.place[id] = std::max(thread.after_acquire_fence.place[id], static_cast<uint8_t>(place));
    thread.after_acquire_fence.join(view);
    if (acquires(order))
    {
      thread.current.join(view);
    }
    if (order == std::memory_order_seq_cst)
    {
      locations[id].sequential = std::max(locations[id].sequential, static_cast<uint8_t>(place));
    }
  }

  size_t lowestPlace(size_t id, std::memory_order order)
  {
    const size_t known = self().current.place[id];
    return order == std::memory_order_seq_cst ? std::max<size_t>(known, locations[id].sequential) : known;
  }

  uint64_t hashOf(const View& view) const
  {
    uint64_t hash = 0;
    for (size_t i = 0; i < locations.size(); ++i)
    {
      hash += view.place[i] == 0 ? 0 : mix(reinterpret_cast<uintptr_t>(locations[i].address) * 257 + view.place[i]);
    }
    for (size_t i = 0; i < MAX_THREADS; ++i)
    {
      hash = mix(hash + view.clock[i]);
    }
    return hash;
  }

  /// Does not depend on the order in which locations were touched first.
  uint64_t hashOfState() const
  {
    uint64_t hash = spurious_failure_left ? 1 : 0;
    for (const std::unique_ptr<Thread>& thread : threads)
    {
      hash = mix(hash * 3 + thread->history);
      hash = mix(hash * 3 + (thread->finished ? 1 : 0));
      hash = mix(hash * 3 + hashOf(thread->current));
      hash = mix(hash * 3 + hashOf(thread->after_acquire_fence));
      hash = mix(hash * 3 + hashOf(thread->at_release_fence));
    }
    uint64_t sum = 0;
    for (const Location& location : locations)
    {
      if (location.messages.size() == 1 && location.sequential == 0)
      {
        continue;  // as if never touched
      }
      uint64_t part = mix(reinterpret_cast<uintptr_t>(location.address) + location.sequential);
      for (const Message& message : location.messages)
      {
        part = mix(part * 5 + message.value);
        part = mix(part * 5 + hashOf(message.view) + (message.followed_by_its_change ? 1 : 0));
      }
      sum += part;
    }
    for (const auto& [address, access] : plain)
    {
      uint64_t part = mix(reinterpret_cast<uintptr_t>(address) + access.writer * 1000 + access.written);
      for (const uint8_t clock : access.read)
      {
        part = mix(part * 5 + clock);
      }
      sum += part;
    }
    for (const auto& [mutex, state] : mutexes)
    {
      sum += mix(reinterpret_cast<uintptr_t>(mutex) + hashOf(state.view) + state.held);
    }
    for (const auto& [bell, rung] : bells)
    {
      sum += rung == 0 ? 0 : mix(reinterpret_cast<uintptr_t>(bell));
    }
    return mix(hash + sum);
  }

  static void enter();
  void execute(const Program& program);
};

}  // namespace weak_memory
