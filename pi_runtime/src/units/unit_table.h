#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>

namespace pi_runtime
{

/// What a process tells the others of one of its streams. Kept in words, as other processes read while it is written.
struct SharedStream
{
  static constexpr size_t WORDS = 14;

  char name[40] = "";
  double period_s = 0.0;  ///< these four as PeriodicLoad
  double deadline_s = 0.0;
  double wcet_s = 0.0;
  double chunk_s = 0.0;
  uint64_t jobs = 0;
  uint64_t missed = 0;
  float p50_s = 0.0F;
  float p99_s = 0.0F;
  float max_s = 0.0F;
  int32_t priority = 0;   ///< real-time priority of its jobs; 0: none
  uint64_t reserved = 0;  ///< 0: its jobs run without reserved capacity
};
static_assert(sizeof(SharedStream) == SharedStream::WORDS * sizeof(uint64_t));

/// Memory that the processes which share one computing unit map. A process may die between any two stores.
///
/// There are no locks. Each change of the holder is one compare-exchange of `holder`. Each change counts up its serial
/// number, so that a decision on an older value has no effect.
struct UnitTable
{
  static constexpr uint64_t MAGIC = 0x656c62617452502e;  // ".PRtable"
  static constexpr uint32_t VERSION = 2;
  static constexpr uint32_t PLACES = 64;
  static constexpr size_t MOST_STREAMS = 16;  ///< of one process

  /// One UnitArbiter of one process.
  struct alignas(64) Place
  {
    std::atomic<uint32_t> waiting;  ///< odd while its acquire() waits; counts up at each change
    std::atomic<uint32_t> wake;     ///< futex that its waiting thread sleeps on
    std::atomic<int32_t> pid;       ///< for messages only: containers have their own numbers
    std::atomic<int32_t> priority;
    std::atomic<int64_t> deadline_ns;
    std::atomic<uint64_t> arrival;  ///< serial number of `holder` when it began to wait
    std::atomic<int64_t> blocking_budget_ns;
    std::atomic<uint32_t> streams_version;  ///< odd while the streams are written
    std::atomic<uint32_t> stream_count;
    std::atomic<uint64_t> streams[MOST_STREAMS][SharedStream::WORDS];
  };

  std::atomic<uint64_t> magic;  ///< written last when the table is made; 0: not complete
  uint32_t version;
  uint32_t places;
  /// Bits 0..7: place of the holder + 1, 0 if free; bit 8: a place waits (never set when free); bit 9: handed to a
  /// waiter that has not seen it yet; bits 16..63: serial number.
  alignas(64) std::atomic<uint64_t> holder;
  Place place[PLACES];
};
static_assert(std::atomic<uint64_t>::is_always_lock_free && std::atomic<int64_t>::is_always_lock_free &&
              std::atomic<uint32_t>::is_always_lock_free);

/// One user's access to a UnitTable in a file, and its place there.
///
/// Each user locks one byte of the file (an open file description lock). The kernel drops the lock when the process
/// ends, so a killed process is seen at once, also from another container and while it is a zombie. The last user
/// removes the file. If all users were killed, the next user makes the file again.
///
/// After construction all methods may be called from any thread. A forked child loses file and memory, since an open
/// file there would hide the death of its parent; table() throws there.
class UnitTableFile
{
public:
  /// Opens the file of the unit `key` (mode 0600), or makes it, and takes a place. Waits for others that come or go.
  /// @throws std::invalid_argument if `key` is empty; std::runtime_error, naming the file and the way out, if the file
  /// belongs to somebody else, is no table of this version, does not fit into the memory, or all places are taken.
  UnitTableFile(const std::string& key, const std::string& folder);
  ~UnitTableFile();
  UnitTableFile(const UnitTableFile&) = delete;
  UnitTableFile& operator=(const UnitTableFile&) = delete;

  /// @throws std::logic_error in a forked child.
  UnitTable& table() const;
  bool isForked() const { return table_ == nullptr; }
  uint32_t ownPlace() const { return place_; }
  /// True if the user of the place lives. One system call, except for the own place.
  bool isAlive(uint32_t place) const;
  const std::string& path() const { return path_; }

private:
  friend struct OpenTables;

  bool openFile();
  void mapTable();
  void checkOrMakeTable();
  void claimPlace();
  bool othersAlive() const;
  void close();
  [[noreturn]] void fail(const std::string& problem, const std::string& way_out) const;

  std::string path_;
  int file_ = -1;
  UnitTable* table_ = nullptr;  ///< null in a forked child
  uint32_t place_ = 0;
};

}  // namespace pi_runtime
