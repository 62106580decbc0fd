#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace pi_os_transport
{

/// What wakes the receiver of a ring, see RingLayout::armed.
enum Doorbell : uint32_t
{
  NETWORK_THREAD = 1,  ///< the thread that serves all connections: by a packet of type BELL
  WAITING_THREAD = 2,  ///< one thread that waits for this ring only: it sleeps on RingLayout::armed
  FIRST_SPINNER = 3,   ///< and above: a thread that waits for callbacks, by its place on the WakeBoard
};

/// Memory that one process makes for one peer: in which links the peer has written since this process last looked.
struct NewsLayout
{
  static constexpr uint32_t LINKS = 4096;
  static constexpr uint64_t MAGIC = 0x347377656e4f5350;  // "PSOnews4"

  uint64_t magic;
  alignas(64) std::atomic<uint64_t> summary;            ///< bit n: links[n] is not 0
  alignas(64) std::atomic<uint64_t> links[LINKS / 64];  ///< one bit each
};

/// One side's view of a NewsLayout. Thread safe.
class NewsBoard
{
public:
  explicit NewsBoard(NewsLayout* layout = nullptr) : layout_(layout) {}

  /// The sender of messages has written into a link's ring.
  /// @return true if the receiver has to be woken; false if that was done for other news that it has not seen yet
  bool add(uint32_t link)
  {
    layout_->links[link / 64].fetch_or(uint64_t{1} << link % 64, std::memory_order_release);
    return layout_->summary.fetch_or(uint64_t{1} << link / 64, std::memory_order_seq_cst) == 0;
  }
  /// The receiver: true if there is news.
  bool any() const { return layout_->summary.load(std::memory_order_seq_cst) != 0; }
  /// The receiver: calls `visit(link)` for each link with news.
  template <typename Visit>
  void take(Visit visit)
  {
    for (uint64_t words = layout_->summary.exchange(0, std::memory_order_acquire); words != 0; words &= words - 1)
    {
      const uint32_t word = static_cast<uint32_t>(__builtin_ctzll(words));
      for (uint64_t bits = layout_->links[word].exchange(0, std::memory_order_acquire); bits != 0; bits &= bits - 1)
      {
        visit(word * 64 + static_cast<uint32_t>(__builtin_ctzll(bits)));
      }
    }
  }

private:
  NewsLayout* layout_;
};

/// Memory that one process makes for all its peers: which of its threads sleep, and how to wake them.
struct WakeLayout
{
  static constexpr uint32_t SLEEPERS = 63;
  static constexpr uint64_t MAGIC = 0x34656b61774f5350;  // "PSOwake4"

  struct alignas(64) Sleeper
  {
    std::atomic<uint32_t> asleep;  ///< 1: wants to be woken; its process
    std::atomic<uint32_t> bell;    ///< wake-ups so far, modulo 2^32; the thread sleeps on it
  };
  uint64_t magic;
  Sleeper sleepers[SLEEPERS];
};

/// One thread that sleeps until a peer or its own process wakes it.
class Sleeper
{
public:
  explicit Sleeper(WakeLayout::Sleeper* place = nullptr) : place_(place) {}

  /// The sleeper: from now on it is woken. What it waits for has to be looked at afterwards, then sleepOn(bell).
  uint32_t prepare()
  {
    const uint32_t bell = place_->bell.load(std::memory_order_relaxed);
    place_->asleep.store(1, std::memory_order_seq_cst);
    return bell;
  }
  /// The sleeper is awake. What it waits for has to be looked at afterwards: the last one to ring saw it asleep.
  void wakeUp() { place_->asleep.store(0, std::memory_order_seq_cst); }
  /// Anyone, after there is something to look at. @return the word to wake; null if the sleeper is awake
  std::atomic<uint32_t>* ring()
  {
    if (place_->asleep.load(std::memory_order_seq_cst) == 0)
    {
      return nullptr;
    }
    place_->bell.fetch_add(1, std::memory_order_relaxed);
    return &place_->bell;
  }
  std::atomic<uint32_t>* word() { return &place_->bell; }

private:
  WakeLayout::Sleeper* place_;
};

}  // namespace pi_os_transport
