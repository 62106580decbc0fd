#pragma once

#include <atomic>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <string>
#include <type_traits>
#include <vector>

/// An operational model of C++'s weak memory and an exhaustive search over it (docs/design/memory_ordering.md).
///
/// Every atomic location holds all its values in modification order, and every thread knows for each location which of
/// them it may not look behind. A load may return any value from there on; a store may take any place after it.
/// Releases and acquires pass that knowledge on. Threads are interleaved before each atomic operation. Code under test
/// is compiled against `Atomic` in place of std::atomic and runs unchanged.
namespace weak_memory
{

/// One atomic operation or fence in the source, as far as it orders memory.
struct Site
{
  std::string function;
  std::string operation;  ///< "head.load"
  std::memory_order order;
  int line;

  bool operator<(const Site& other) const;
  std::string toString() const;
};

/// A site and the weaker order that it is to have.
struct Mutation
{
  Site site;
  std::memory_order order = std::memory_order_relaxed;
  std::string toString() const;
};
const char* nameOf(std::memory_order order);
/// The next weaker orders of what `site` does; empty for relaxed.
std::vector<std::memory_order> weakerThan(const Site& site);

/// What the code under test runs in. All functions but run() and the ones marked so are called by the code under test.
class Model
{
public:
  struct Result
  {
    std::string failure;  ///< empty: every execution held; else what did not, and the schedule that led there
    uint64_t executions = 0;
    uint64_t states = 0;
  };
  using Body = std::function<void()>;

  /// One execution: what comes before the threads start, the threads, and what must hold in the end.
  struct Program
  {
    std::function<void()> prepare;  ///< sets everything up anew; sequential
    std::vector<Body> threads;
    std::function<void()> finish;  ///< sequential, after all threads and with all they know
  };

  static Model& instance();

  /// Executes the program in every way that the model allows. Called from outside.
  Result run(const Program& program, const Mutation* mutation = nullptr);
  /// All ordered operations that the runs so far have come across. Called from outside.
  const std::map<Site, uint64_t>& sites() const { return sites_; }

  /// Gives a location a name in reports. Any time.
  void name(const void* address, const std::string& name);

  /// Ends this execution as a failure unless `condition` holds.
  void require(bool condition, const std::string& what);

  uint64_t load(const void* address, uint64_t* raw, std::memory_order order, const char* function, int line);
  void store(const void* address, uint64_t* raw, uint64_t value, std::memory_order order, const char* function,
             int line);
  using Change = std::function<bool(uint64_t, uint64_t*)>;
  /// Read, and if `change` says so, write right behind what was read. @return what was read.
  uint64_t readModifyWrite(const void* address, uint64_t* raw, const Change& change, bool may_fail_spuriously,
                           bool* changed, std::memory_order order, std::memory_order failure_order,
                           const char* operation, const char* function, int line);
  void fence(std::memory_order order, const char* function, int line);
  /// Not ordered and not atomic: anything concurrent with a write is a failure.
  void readPlain(const void* address);
  void writePlain(const void* address);
  /// A mutex; who can never get it makes the execution a failure.
  void lock(const void* mutex);
  void unlock(const void* mutex);
  /// An eventfd, which orders no memory: ring() adds to it, awaitRing() waits until something is there and clears it.
  /// Waiting for ever is a failure.
  void ring(const void* bell);
  void awaitRing(const void* bell);

private:
  struct Machine;
  Model();
  std::memory_order effective(const char* operation, const void* address, std::memory_order order, const char* function,
                              int line);
  void note(const std::function<std::string()>& line);
  std::string nameOfLocation(const void* address) const;

  Machine* machine_;
  const Mutation* mutation_ = nullptr;
  std::map<Site, uint64_t> sites_;
  std::map<const void*, std::string> names_;
};

/// Stands in for std::atomic. Outside of Model::run()'s threads it is a plain variable.
template <typename T>
class Atomic
{
public:
  static constexpr bool is_always_lock_free = true;

  Atomic() = default;
  Atomic(T value) : raw_(bits(value)) {}  // NOLINT: std::atomic converts as well
  Atomic(const Atomic&) = delete;
  Atomic& operator=(const Atomic&) = delete;

  T load(std::memory_order order = std::memory_order_seq_cst, const char* function = __builtin_FUNCTION(),
         int line = __builtin_LINE()) const
  {
    return value(Model::instance().load(this, &raw_, order, function, line));
  }
  void store(T value, std::memory_order order = std::memory_order_seq_cst, const char* function = __builtin_FUNCTION(),
             int line = __builtin_LINE())
  {
    Model::instance().store(this, &raw_, bits(value), order, function, line);
  }
  T operator=(T value)
  {
    store(value);
    return value;
  }
  operator T() const { return load(); }
  T exchange(T value, std::memory_order order = std::memory_order_seq_cst, const char* function = __builtin_FUNCTION(),
             int line = __builtin_LINE())
  {
    return change([value](T) { return value; }, "exchange", order, function, line);
  }
  T fetch_add(T operand, std::memory_order order = std::memory_order_seq_cst,
              const char* function = __builtin_FUNCTION(), int line = __builtin_LINE())
  {
    return change([operand](T old) { return static_cast<T>(old + operand); }, "fetch_add", order, function, line);
  }
  T fetch_sub(T operand, std::memory_order order = std::memory_order_seq_cst,
              const char* function = __builtin_FUNCTION(), int line = __builtin_LINE())
  {
    return change([operand](T old) { return static_cast<T>(old - operand); }, "fetch_sub", order, function, line);
  }
  T fetch_or(T operand, std::memory_order order = std::memory_order_seq_cst,
             const char* function = __builtin_FUNCTION(), int line = __builtin_LINE())
  {
    return change([operand](T old) { return static_cast<T>(old | operand); }, "fetch_or", order, function, line);
  }
  bool compare_exchange_strong(T& expected, T desired, std::memory_order order = std::memory_order_seq_cst,
                               const char* function = __builtin_FUNCTION(), int line = __builtin_LINE())
  {
    return compareExchange(expected, desired, false, order, function, line);
  }
  bool compare_exchange_weak(T& expected, T desired, std::memory_order order = std::memory_order_seq_cst,
                             const char* function = __builtin_FUNCTION(), int line = __builtin_LINE())
  {
    return compareExchange(expected, desired, true, order, function, line);
  }

private:
  static uint64_t bits(T value)
  {
    uint64_t raw = 0;
    std::memcpy(&raw, &value, sizeof(value));
    return raw;
  }
  static T value(uint64_t raw)
  {
    T value;
    std::memcpy(&value, &raw, sizeof(value));
    return value;
  }
  template <typename Function>
  T change(Function next, const char* operation, std::memory_order order, const char* function, int line)
  {
    bool changed;
    return value(Model::instance().readModifyWrite(
        this, &raw_,
        [next](uint64_t old, uint64_t* out)
        {
          *out = bits(next(value(old)));
          return true;
        },
        false, &changed, order, order, operation, function, line));
  }
  bool compareExchange(T& expected, T desired, bool weak, std::memory_order order, const char* function, int line)
  {
    const std::memory_order failure_order = order == std::memory_order_acq_rel   ? std::memory_order_acquire
                                            : order == std::memory_order_release ? std::memory_order_relaxed
                                                                                 : order;
    bool changed = false;
    const T wanted = expected;
    expected = value(Model::instance().readModifyWrite(
        this, &raw_,
        [wanted, desired](uint64_t old, uint64_t* out)
        {
          *out = bits(desired);
          return old == bits(wanted);
        },
        weak, &changed, order, failure_order, "compare_exchange", function, line));
    return changed;
  }

  mutable uint64_t raw_ = 0;
};

inline void fence(std::memory_order order, const char* function = __builtin_FUNCTION(), int line = __builtin_LINE())
{
  Model::instance().fence(order, function, line);
}

/// Stands in for std::mutex.
class Mutex
{
public:
  void lock() { Model::instance().lock(this); }
  void unlock() { Model::instance().unlock(this); }
};

}  // namespace weak_memory
