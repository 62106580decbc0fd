#pragma once

#include <ros/callback_queue.h>
#include <ros/node_handle.h>

#include <atomic>
#include <functional>
#include <string>
#include <thread>

namespace pi_node
{

/// A queue of callbacks with a thread of its own that serves it.
class CallbackThread
{
public:
  /// @param name  of the thread, at most 15 characters.
  explicit CallbackThread(const std::string& name);
  ~CallbackThread();
  CallbackThread(const CallbackThread&) = delete;
  CallbackThread& operator=(const CallbackThread&) = delete;

  /// The same handle, whose callbacks come on this thread.
  ros::NodeHandle handle(ros::NodeHandle node);

  /// Calls a function on this thread, once, after what waits already.
  void post(std::function<void()> function);

  void start();
  /// Returns when the callback in work has returned; no more come afterwards.
  void stop();

private:
  const std::string name_;
  ros::CallbackQueue queue_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace pi_node
