#pragma once

#include <pi_speech/RecognizeUtterance.h>
#include <pi_speech/command_recognizer.h>
#include <ros/ros.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace pi_speech
{

/// Asks a service (RecognizeUtterance) what was said, with a deadline: roscpp itself waits forever for a server that
/// hangs.
class UtteranceService
{
public:
  /// @param node        its namespace resolves the name. @param deadline_s  for an answer [s].
  UtteranceService(ros::NodeHandle node, const std::string& service, double deadline_s);
  /// Breaks the connection of a call in progress and waits for it.
  ~UtteranceService();
  UtteranceService(const UtteranceService&) = delete;
  UtteranceService& operator=(const UtteranceService&) = delete;

  /// @param commands  of the table. @return nothing if the service is missing, late, or does not handle the utterance.
  /// Not thread safe; returns within deadline_s.
  std::optional<Recognition> ask(const Utterance& utterance, const std::vector<std::string>& commands);

  const std::string& name() const { return name_; }

private:
  /// A call, shared with the thread, which may outlast the caller's wait.
  struct Call
  {
    RecognizeUtterance service;
    bool done = false;
    bool ok = false;
  };
  void run();

  ros::NodeHandle node_;
  const std::string name_;
  const double deadline_s_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<Call> next_;
  bool busy_ = false;
  bool stopping_ = false;
  ros::ServiceClient client_;  ///< used by the thread; shut down by the destructor
  std::thread thread_;
};

}  // namespace pi_speech
