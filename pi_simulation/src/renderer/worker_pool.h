#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace pi_simulation::synthetic
{

/// Threads that share the steps of a loop. The caller is one of them: a pool of one has no thread of its own.
class WorkerPool
{
public:
  explicit WorkerPool(int threads);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// Calls `step` for 0 to count - 1, in any order and on any thread, and returns when all are done. `step` must not
  /// throw. Only one thread may call this at a time.
  void run(int count, const std::function<void(int)>& step);

private:
  void work();
  void takeSteps(std::unique_lock<std::mutex>* lock);

  std::mutex mutex_;
  std::condition_variable changed_;
  const std::function<void(int)>* step_ = nullptr;
  int next_ = 0;
  int count_ = 0;
  int running_ = 0;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace pi_simulation::synthetic
