#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_speech/sphinx_decoder.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace pi_speech
{

/// Writes down speech that is no command, on the thread `speech_dictate` with low priority.
class Dictation
{
public:
  struct Figures
  {
    std::string problem;  ///< why nothing is written down; empty: none
    uint64_t written = 0;
    uint64_t dropped = 0;  ///< utterances, because others waited
  };

  /// Begins to load the model. @param written  gets each text, on the thread of dictation. @param warnings  outlives
  /// it.
  Dictation(const SphinxModel& model, pi_node::WarningBoard* warnings,
            std::function<void(const std::string& text)> written);
  ~Dictation();
  Dictation(const Dictation&) = delete;
  Dictation& operator=(const Dictation&) = delete;

  /// Nothing happens before the model is loaded. Any thread.
  void add(const Samples& utterance);
  /// Returns when an utterance in work is done. Not thread safe.
  void stop();
  Figures figures() const;  ///< Any thread.

private:
  void run();

  const SphinxModel model_;
  pi_node::WarningBoard* const warnings_;
  const std::function<void(const std::string& text)> written_;
  mutable std::mutex mutex_;  ///< of all below
  std::condition_variable changed_;
  bool stopping_ = false;
  bool ready_ = false;
  std::deque<Samples> utterances_;
  Figures figures_;
  std::thread thread_;
};

}  // namespace pi_speech
