#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>

namespace pi_offload
{

/// The clock of all instants *_ns: monotonic, the same in all processes of a computer.
int64_t monotonicNs();  // in socket_tools.cpp

/// A thread that runs functions in the order in which they were posted, and a timer beside them. It sleeps in between.
class EventThread
{
public:
  using Function = std::function<void(int64_t now_ns)>;
  struct Callbacks
  {
    std::function<int64_t()> next_time;  ///< when on_time wants to be called [ns]; INT64_MAX: never
    Function on_time;
    std::function<void(const std::string& text)> failed;  ///< something threw; the thread goes on
  };

  /// @param name  of the thread, at most 15 characters.
  EventThread(const std::string& name, Callbacks callbacks);
  ~EventThread();
  EventThread(const EventThread&) = delete;
  EventThread& operator=(const EventThread&) = delete;

  void start();
  /// Ends the thread after the function in work; those that wait are dropped. Any thread but its own.
  void stop();

  /// Any thread; after stop() nothing happens.
  void post(Function function);

  /// Runs a function on the thread, and waits for what it returns. Any thread but its own.
  /// @throws what the function throws; std::future_error after stop().
  template <typename Callable>
  auto call(Callable&& callable) -> std::invoke_result_t<Callable, int64_t>
  {
    using Result = std::invoke_result_t<Callable, int64_t>;
    auto task = std::make_shared<std::packaged_task<Result(int64_t)>>(std::forward<Callable>(callable));
    std::future<Result> result = task->get_future();
    // Nobody else holds the task then: where it is dropped, its promise is broken, and nobody waits for ever.
    post([task = std::move(task)](int64_t now_ns) { (*task)(now_ns); });
    return result.get();
  }

private:
  void run();

  const std::string name_;
  const Callbacks callbacks_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;
  std::deque<Function> functions_;
  std::thread thread_;
};

}  // namespace pi_offload
