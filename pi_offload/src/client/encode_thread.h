#pragma once

#include "client/offload_client.h"

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_offload
{

/// Encodes pictures one after the other, on a thread of its own.
class EncodeThread
{
public:
  struct Job
  {
    std::shared_ptr<const TaskData> data;
    Encoding encoding = Encoding::JPEG;
    /// On this thread. @param problem  why there are no bytes; empty: there are.
    std::function<void(std::vector<uint8_t> bytes, const std::string& problem)> done;
  };
  /// @param encoder  outlives this object.
  EncodeThread(size_t max_waiting, PictureEncoder& encoder);
  ~EncodeThread();
  EncodeThread(const EncodeThread&) = delete;
  EncodeThread& operator=(const EncodeThread&) = delete;

  void start();
  /// Jobs that wait are dropped.
  void stop();
  /// @return false: too many wait.
  bool add(Job job);

private:
  void run();

  const size_t max_waiting_;
  PictureEncoder& encoder_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false;
  std::deque<Job> jobs_;
  std::thread thread_;
};

}  // namespace pi_offload
