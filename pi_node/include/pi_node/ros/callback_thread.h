#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>

#include <atomic>
#include <functional>
#include <string>
#include <thread>

namespace pi_node
{

/// A callback queue and the thread that serves it.
class CallbackThread
{
public:
  /// @param name  of the thread, at most 15 characters.
  explicit CallbackThread(const std::string& name);
  ~CallbackThread();
  CallbackThread(const CallbackThread&) = delete;
  CallbackThread& operator=(const CallbackThread&) = delete;

  /// The same handle with its callbacks on this thread.
  ros::NodeHandle handle(ros::NodeHandle node);

  /// Calls a function once on this thread, after the callbacks in the queue.
  void post(std::function<void()> function);

  void start();
  /// Returns when the current callback has returned. No callback comes afterwards.
  void stop();

private:
  const std::string name_;
  ros::CallbackQueue queue_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace pi_node
