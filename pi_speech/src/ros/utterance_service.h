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

/// Asks a service (RecognizeUtterance) what was said, and does without its answer where it is not there in time: roscpp
/// itself waits for ever for a server that hangs.
class UtteranceService
{
public:
  /// @param node        its namespace resolves the name. @param deadline_s  until the answer must be there, the
  ///   vehicle's own decision included [s].
  UtteranceService(ros::NodeHandle node, const std::string& service, double deadline_s);
  /// Waits for a call under way, whose connection it breaks.
  ~UtteranceService();
  UtteranceService(const UtteranceService&) = delete;
  UtteranceService& operator=(const UtteranceService&) = delete;

  /// @param commands  that can be said. @return nothing if the service is not there, does not handle it, or is late.
  /// Not thread safe; returns within deadline_s.
  std::optional<Recognition> ask(const Utterance& utterance, const std::vector<std::string>& commands);

  const std::string& name() const { return name_; }

private:
  /// A call; shared with the thread, which may still be in it when the caller has gone on.
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
