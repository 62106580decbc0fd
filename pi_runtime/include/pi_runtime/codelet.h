#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include <pi_runtime/buffer.h>

namespace pi_runtime
{

class OpenClCommand;

/// One argument of a task, for every implementation of its codelet: a buffer with its access, or a value.
class Argument
{
public:
  static constexpr size_t MAX_VALUE_BYTES = 32;

  static Argument in(BufferPtr buffer) { return Argument(std::move(buffer), Access::READ); }
  static Argument out(BufferPtr buffer) { return Argument(std::move(buffer), Access::WRITE); }
  static Argument inOut(BufferPtr buffer) { return Argument(std::move(buffer), Access::READ_WRITE); }
  template <typename T>
  static Argument value(const T& value)
  {
    static_assert(std::is_trivially_copyable<T>::value && sizeof(T) <= MAX_VALUE_BYTES, "a small plain type");
    return Argument(&value, sizeof(T));
  }
  /// A value of up to MAX_VALUE_BYTES raw bytes. @throws std::invalid_argument if there are more, or none.
  static Argument bytes(const void* data, size_t size);

  bool isBuffer() const { return buffer_ != nullptr; }
  const BufferPtr& buffer() const { return buffer_; }
  Access access() const { return access_; }
  const void* valueData() const { return value_.data(); }
  size_t valueBytes() const { return value_bytes_; }

private:
  Argument(BufferPtr buffer, Access access);
  Argument(const void* value, size_t bytes) : value_bytes_(bytes) { std::memcpy(value_.data(), value, bytes); }

  BufferPtr buffer_;
  Access access_ = Access::READ;
  alignas(16) std::array<uint8_t, MAX_VALUE_BYTES> value_{};
  size_t value_bytes_ = 0;
};

/// The arguments of a task for its implementation, and the slice of its range to work on.
class TaskArguments
{
public:
  TaskArguments(const std::vector<Argument>& arguments, uint64_t begin, uint64_t end, uint64_t range)
    : arguments_(arguments), begin_(begin), end_(end), range_(range)
  {
  }

  size_t size() const { return arguments_.size(); }
  /// @throws std::out_of_range naming the index if there is no such argument.
  const Argument& at(size_t index) const;
  /// The value of argument index. @throws std::invalid_argument if it is no value of T's size.
  template <typename T>
  T value(size_t index) const
  {
    T result;
    copyValue(index, &result, sizeof(T));
    return result;
  }
  /// Bytes of the buffer at index. @throws std::invalid_argument if it is no buffer.
  size_t bufferBytes(size_t index) const { return bufferAt(index).bytes(); }

  /// The slice of the task's range to work on now: [begin, end) of [0, range).
  uint64_t begin() const { return begin_; }
  uint64_t end() const { return end_; }
  uint64_t range() const { return range_; }

protected:
  Buffer& bufferAt(size_t index) const;

private:
  void copyValue(size_t index, void* to, size_t bytes) const;

  const std::vector<Argument>& arguments_;
  const uint64_t begin_;
  const uint64_t end_;
  const uint64_t range_;
};

/// The call of a native implementation, on the thread of the unit.
class NativeCall : public TaskArguments
{
public:
  NativeCall(const std::vector<Argument>& arguments, uint64_t begin, uint64_t end, uint64_t range,
             const std::atomic<bool>* cancelled)
    : TaskArguments(arguments, begin, end, range), cancelled_(cancelled)
  {
  }

  /// The memory of the buffer at index, content as its access says. @throws std::invalid_argument if it is no buffer.
  template <typename T>
  T* buffer(size_t index) const
  {
    return static_cast<T*>(bufferAt(index).address());
  }
  /// True if the task was cancelled. Long functions poll this and return early.
  bool cancelled() const { return cancelled_ != nullptr && cancelled_->load(std::memory_order_relaxed); }

private:
  const std::atomic<bool>* cancelled_;
};

/// Kinds of computing units.
enum class UnitType : uint8_t
{
  CPU = 1,
  GPU = 2,
  ACCELERATOR = 4,
};
constexpr uint8_t ANY_UNIT_TYPE = 7;
const char* toString(UnitType type);

/// Runs on the unit's thread. May throw: the task then fails with the exception's text.
using NativeFunction = std::function<void(const NativeCall&)>;
/// Enqueues any number of kernels. Must not block. May throw, as above.
using OpenClFunction = std::function<void(OpenClCommand&)>;

struct NativeImplementation
{
  NativeFunction function;
  /// Types of units whose thread may run it (bits of UnitType). For types other than CPU the function is host code that
  /// drives such a unit, for example a network on a GPU.
  uint8_t unit_types = static_cast<uint8_t>(UnitType::CPU);
};

struct OpenClImplementation
{
  std::string source;   ///< OpenCL C 1.2
  std::string options;  ///< of the compiler, as "-DRADIUS=3 -cl-mad-enable"
  /// The kernels that the function uses. They are created before the first run, which checks their names.
  std::vector<std::string> kernels;
  OpenClFunction function;
};

/// A computation with one or more implementations. All take the same arguments and give the same results (within the
/// codelet's stated tolerance).
struct Codelet
{
  std::string name;                          ///< key of the ETC table: one word, unique in the process
  std::vector<NativeImplementation> native;  ///< at most one
  std::vector<OpenClImplementation> opencl;  ///< at most one
  /// The range may run in several slices, with other tasks in between.
  bool sliceable = false;
  /// Slices begin at multiples of this (a kernel's local size, a row of blocks).
  uint64_t slice_granularity = 1;

  /// @throws std::invalid_argument naming what is missing or wrong.
  void validate() const;
};
using CodeletPtr = std::shared_ptr<const Codelet>;

/// Validates and shares. @throws std::invalid_argument
CodeletPtr makeCodelet(Codelet codelet);

}  // namespace pi_runtime
