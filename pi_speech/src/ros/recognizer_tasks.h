#pragma once

#include <pi_runtime/runtime.h>

#include <chrono>
#include <cstdint>
#include <ctime>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

namespace pi_speech
{

/// Runs the decisions of a recogniser as native tasks "speech_decode" of a runtime, one after the other.
///
/// Their size is the speech in milliseconds. They have a deadline, and so go before everything that has none, such as
/// the network of a picture. What a unit has begun is not interrupted, though: a task that no unit has begun within
/// the patience is taken back, and the decision is a plain call, so that a command never waits for other work. A task
/// that fails is told, and the decision is a plain call as well.
class RecognizerTasks
{
public:
  static constexpr char CODELET[] = "speech_decode";
  static constexpr std::chrono::milliseconds DEADLINE{100};  ///< in which a vehicle's command is expected to be decided
  static constexpr std::chrono::milliseconds PATIENCE{20};  ///< in the queue, unless the constructor was told otherwise

  /// @param tell_error  is called by run() with what failed and what was done instead.
  RecognizerTasks(std::shared_ptr<pi_runtime::Runtime> runtime, std::function<void(const std::string& text)> tell_error,
                  std::chrono::nanoseconds patience = PATIENCE)
    : runtime_(std::move(runtime))
    , tell_error_(std::move(tell_error))
    , patience_(patience)
    , order_(std::make_shared<Order>())
  {
    pi_runtime::Codelet codelet;
    codelet.name = CODELET;
    pi_runtime::NativeImplementation native;
    native.function = [order = order_](const pi_runtime::NativeCall& call) { order->serve(call.value<uint64_t>(0)); };
    codelet.native = {std::move(native)};
    codelet_ = pi_runtime::makeCodelet(std::move(codelet));
  }

  /// Returns when the work was done once, or has thrown in the plain call. One thread at a time.
  /// @param speech_s  in the utterance [s].
  void run(double speech_s, const std::function<void()>& work)
  {
    const uint64_t number = order_->begin(&work);
    pi_runtime::TaskRequest task;
    task.codelet = codelet_;
    task.arguments = {pi_runtime::Argument::value(number)};
    task.size = 1e3 * speech_s;
    task.deadline = DEADLINE;
    const pi_runtime::TaskHandle handle = runtime_->submit(std::move(task));
    if (!handle.waitFor(patience_) && order_->takeBack())
    {
      handle.cancel();
      ++figures_.taken_back;
      work();
      return;
    }
    const pi_runtime::TaskResult& result = handle.wait();
    // Waits for a function that the runtime has given up.
    if (order_->end(&figures_.cpu_s))
    {
      ++figures_.tasks;
      figures_.unit = result.unit;
      return;
    }
    ++figures_.failed;
    tell_error_(std::string(CODELET) + ": " + toString(result.outcome) + ": " + result.message +
                "; decided without the runtime, as use_runtime false does always");
    work();
  }

  struct Figures
  {
    uint64_t tasks = 0;  ///< that ran
    uint64_t taken_back = 0;
    uint64_t failed = 0;
    double cpu_s = 0.0;  ///< that the tasks used, on the units' threads
    std::string unit;    ///< that ran the last; empty: none yet
  };
  /// On the thread of run().
  const Figures& figures() const { return figures_; }

private:
  /// The work in hand. Belongs to the codelet, whose function the runtime may call late.
  class Order
  {
  public:
    uint64_t begin(const std::function<void()>* work)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      work_ = work;
      done_ = false;
      return ++number_;
    }
    /// On a unit's thread.
    void serve(uint64_t number)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (number != number_ || work_ == nullptr)
      {
        return;  // was taken back
      }
      const double begin_s = threadCpuSeconds();
      (*work_)();
      cpu_s_ = threadCpuSeconds() - begin_s;
      done_ = true;
    }
    /// @return false if it has begun.
    bool takeBack()
    {
      const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
      if (!lock.owns_lock() || done_)
      {
        return false;
      }
      work_ = nullptr;
      return true;
    }
    /// @return whether it was done.
    bool end(double* cpu_s)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      work_ = nullptr;
      *cpu_s += done_ ? cpu_s_ : 0.0;
      return done_;
    }

  private:
    static double threadCpuSeconds()
    {
      timespec time{};
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
      return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
    }

    std::mutex mutex_;  ///< held while the work is done
    const std::function<void()>* work_ = nullptr;
    uint64_t number_ = 0;
    bool done_ = false;
    double cpu_s_ = 0.0;
  };

  const std::shared_ptr<pi_runtime::Runtime> runtime_;
  const std::function<void(const std::string& text)> tell_error_;
  const std::chrono::nanoseconds patience_;
  const std::shared_ptr<Order> order_;
  pi_runtime::CodeletPtr codelet_;
  Figures figures_;
};

}  // namespace pi_speech
