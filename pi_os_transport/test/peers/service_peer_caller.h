#pragma once

#include <ros/ros.h>
#include <sensor_msgs/SetCameraInfo.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <thread>

#include "peers/peer_command.h"
#include "peers/peer_json.h"
#include "peers/service_pattern.h"

/// Calls a service from a thread of its own.
class Caller
{
  using Clock = std::chrono::steady_clock;

public:
  explicit Caller(const Command& c)
    : service_(c.text("service"))
    , count_(c.integer("count", 1))
    , size_(static_cast<size_t>(c.integer("size", 80)))
    , answer_(static_cast<uint32_t>(c.integer("answer", 20)))
    , persistent_(c.integer("persistent", 0) != 0)
    , rate_hz_(c.real("rate", 0))
    , renew_(c.integer("renew", 0) != 0)
    , thread_([this] { run(); })
  {
  }
  ~Caller() { stop(); }

  void join()
  {
    if (thread_.joinable())
    {
      thread_.join();
    }
  }
  void stop()
  {
    stopped_ = true;
    join();
  }

  /// Shuts the client down under a call that waits.
  void shutdownClient()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    ros::ServiceClient client = client_;
    lock.unlock();
    client.shutdown();
  }

  bool awaitCalls(uint64_t further, std::chrono::milliseconds timeout)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const uint64_t wanted = succeeded_ + further;
    return changed_.wait_for(lock, timeout, [&] { return succeeded_ >= wanted; });
  }

  bool awaitFailed(uint64_t failed, std::chrono::milliseconds timeout)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, timeout, [&] { return failed_ >= failed; });
  }

  void report(JsonObject* out)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    out->number("calls", succeeded_ + failed_).number("failed", failed_).number("wrong", wrong_);
    out->number("slowest_us", slowest_us_).number("reconnected", reconnected_).boolean("valid", valid_);
    out->number("still_valid", still_valid_).boolean("single_shot", !persistent_);
  }

private:
  void run()
  {
    ros::NodeHandle node;
    ros::ServiceClient client;
    bool answered = true;
    auto next = Clock::now();
    for (long done = 0; !stopped_ && ros::ok() && (count_ == 0 || done < count_); ++done)
    {
      if (!client || (persistent_ && (!client.isValid() || (renew_ && !answered))))
      {
        // A persistent client whose connection has ended has to be made anew, says roscpp's documentation.
        std::lock_guard<std::mutex> lock(mutex_);
        reconnected_ += client ? 1 : 0;
        client = node.serviceClient<sensor_msgs::SetCameraInfo>(service_, persistent_);
        client_ = client;
      }
      answered = callOnce(static_cast<uint32_t>(done + 1), &client);
      if (rate_hz_ > 0)
      {
        next += std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz_));
        std::this_thread::sleep_until(next);
      }
    }
    std::lock_guard<std::mutex> lock(mutex_);
    client_ = ros::ServiceClient();  // a persistent connection ends with the calls
  }

  /// @return true if the call came back with an answer.
  bool callOnce(uint32_t number, ros::ServiceClient* client)
  {
    sensor_msgs::SetCameraInfo service;
    fillRequest(number, size_, answer_, &service.request.camera_info);
    const auto start = Clock::now();
    const bool ok = client->call(service);
    const int64_t took = std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - start).count();
    const bool valid = client->isValid();
    const bool right =
        ok && service.response.success &&
        service.response.status_message == answerText(number, service.request.camera_info.D.size(), answer_);
    std::lock_guard<std::mutex> lock(mutex_);
    slowest_us_ = std::max(slowest_us_, took);
    valid_ = valid;
    failed_ += ok ? 0 : 1;
    still_valid_ += !ok && persistent_ && valid ? 1 : 0;
    wrong_ += ok && !right ? 1 : 0;
    succeeded_ += ok ? 1 : 0;
    changed_.notify_all();
    return ok;
  }

  const std::string service_;
  const long count_;
  const size_t size_;
  const uint32_t answer_;
  const bool persistent_;
  const double rate_hz_;
  const bool renew_;
  std::mutex mutex_;  ///< guards the counters
  std::condition_variable changed_;
  uint64_t succeeded_ = 0;
  uint64_t failed_ = 0;
  uint64_t wrong_ = 0;
  uint64_t reconnected_ = 0;
  bool valid_ = false;         ///< the client after the last call
  uint64_t still_valid_ = 0;   ///< failed persistent calls after which the client said that it was valid
  ros::ServiceClient client_;  ///< the one in use
  int64_t slowest_us_ = 0;
  std::atomic<bool> stopped_{false};
  std::thread thread_;
};
