#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>

namespace pi_bringup
{

/// First-in, first-out queue between one producer and one consumer thread that holds at most `capacity` items.
/// push() and pop() block; close() wakes both sides for good. Any thread may call any method.
template <typename T>
class BoundedQueue
{
public:
  /// @throws std::invalid_argument if capacity is 0: nothing could ever be pushed.
  explicit BoundedQueue(size_t capacity) : capacity_(capacity)
  {
    if (capacity == 0)
    {
      throw std::invalid_argument("BoundedQueue: capacity = 0, must be at least 1");
    }
  }

  /// Waits for room and appends. @return false if the queue was closed; the item is then dropped.
  bool push(T item)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    not_full_.wait(lock, [this] { return closed_ || items_.size() < capacity_; });
    if (closed_)
    {
      return false;
    }
    items_.push_back(std::move(item));
    not_empty_.notify_one();
    return true;
  }

  /// Waits for an item and takes it. After close() the remaining items are still handed out, then nullopt for ever.
  std::optional<T> pop()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    not_empty_.wait(lock, [this] { return closed_ || !items_.empty(); });
    if (items_.empty())
    {
      return std::nullopt;
    }
    std::optional<T> item(std::move(items_.front()));
    items_.pop_front();
    not_full_.notify_one();
    return item;
  }

  /// Ends the exchange; idempotent.
  void close()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
    not_full_.notify_all();
    not_empty_.notify_all();
  }

  size_t size() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return items_.size();
  }

private:
  const size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable not_full_;
  std::condition_variable not_empty_;
  std::deque<T> items_;
  bool closed_ = false;
};

}  // namespace pi_bringup
