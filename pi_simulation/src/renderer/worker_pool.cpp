#include "renderer/worker_pool.h"

namespace pi_simulation::synthetic
{

WorkerPool::WorkerPool(int threads)
{
  for (int i = 1; i < threads; ++i)
  {
    threads_.emplace_back([this] { work(); });
  }
}

WorkerPool::~WorkerPool()
{
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_)
  {
    thread.join();
  }
}

void WorkerPool::run(int count, const std::function<void(int)>& step)
{
  std::unique_lock<std::mutex> lock(mutex_);
  step_ = &step;
  next_ = 0;
  count_ = count;
  changed_.notify_all();
  takeSteps(&lock);
  changed_.wait(lock, [this] { return running_ == 0; });
}

/// Takes steps until none is left. The lock is held on entry and on return, but not during a step.
void WorkerPool::takeSteps(std::unique_lock<std::mutex>* lock)
{
  while (next_ < count_)
  {
    const int index = next_++;
    ++running_;
    lock->unlock();
    (*step_)(index);
    lock->lock();
    --running_;
  }
  changed_.notify_all();
}

void WorkerPool::work()
{
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stopping_)
  {
    takeSteps(&lock);
    changed_.wait(lock, [this] { return stopping_ || next_ < count_; });
  }
}

}  // namespace pi_simulation::synthetic
