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

/// A thread that runs posted functions in their order, and a timer function beside them.
class EventThread
{
public:
  using Function = std::function<void(int64_t now_ns)>;
  struct Callbacks
  {
    std::function<int64_t()> next_time;  ///< when to call on_time [ns]; empty or INT64_MAX: never
    Function on_time;
    std::function<void(const std::string& text)> failed;  ///< a function threw; the thread goes on
  };

  /// @param name  of the thread, at most 15 characters.
  EventThread(const std::string& name, Callbacks callbacks);
  ~EventThread();
  EventThread(const EventThread&) = delete;
  EventThread& operator=(const EventThread&) = delete;

  void start();
  /// Ends the thread after the function in work; drops those that wait. Not from the thread itself.
  void stop();

  /// From any thread. Does nothing after stop().
  void post(Function function);

  /// Runs a function on the thread and waits for its result. Not from the thread itself.
  /// @throws what the function throws; std::future_error after stop().
  template <typename Callable>
  auto call(Callable&& callable) -> std::invoke_result_t<Callable, int64_t>
  {
    using Result = std::invoke_result_t<Callable, int64_t>;
    auto task = std::make_shared<std::packaged_task<Result(int64_t)>>(std::forward<Callable>(callable));
    std::future<Result> result = task->get_future();
    // The thread holds the only reference: if it drops the task, the promise breaks and the caller stops waiting.
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
