#pragma once

#include <pi_node/ros/callback_thread.h>
#include <pi_speech/SetCommands.h>
#include <ros/node_handle.h>

#include <string>
#include <vector>

#include "ros/recognizer_worker.h"

namespace pi_speech
{

/// Loads tables of commands and models for the worker, on the thread `speech_loader`; offers the service
/// `set_commands`.
class CommandLoader
{
public:
  /// Loads the table of the parameters once start() is called. @param options, worker  outlive it.
  /// @param package  folder of pi_speech.
  CommandLoader(ros::NodeHandle private_node, const RecognizerRosOptions& options, const std::string& package,
                RecognizerWorker* worker);

  void start() { thread_.start(); }
  /// Returns when a model that is being loaded is loaded.
  void stop();

private:
  /// Commands asked for: of a file, or else these.
  struct Source
  {
    std::string file;
    std::vector<std::string> texts;
    std::string name() const;
  };

  /// @param[out] message  what is understood, or why the source cannot be used.
  bool load(const Source& source, std::string* message);
  bool setCommands(SetCommands::Request& request, SetCommands::Response& response);

  pi_node::CallbackThread thread_;
  ros::NodeHandle private_node_;
  const RecognizerRosOptions& options_;
  const std::string package_;
  RecognizerWorker* const worker_;
  Source asked_for_;
  ros::ServiceServer service_;
};

}  // namespace pi_speech
