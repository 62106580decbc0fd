#pragma once

#include <pi_detect/ssd_detector.h>
#include "server/edge_server.h"
#include <pi_speech/command_recognizer.h>

#include <cstdint>
#include <string>
#include <vector>

namespace pi_offload
{

/// What a node does for vehicles: the same detector and recogniser as on the vehicle. In a library of its own
/// (pi_offload_executors), as they bring OpenCV and PocketSphinx with them.

struct DetectionExecutorOptions
{
  std::string model;                    ///< YAML file of the network, as of pi_detect
  pi_detect::DetectorOptions detector;  ///< `threads` is for the whole process: with several workers, 1 is best
  uint32_t max_side = 8192;             ///< of pictures [px]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Objects in pictures. Takes JPEG, BGR8, RGB8 and MONO8. The model is checked once, by the first executor.
/// @throws std::invalid_argument for options, pi_detect::ModelError for the description of the model.
ExecutorFactory detectionExecutor(const DetectionExecutorOptions& options);

struct SpeechExecutorOptions
{
  pi_speech::RecognizerOptions recognizer;
  pi_speech::CommandTable commands;  ///< the node's own: where a request has none
  double max_sound_s = 10.0;         ///< of a request
  size_t max_commands = 200;         ///< of a request
  size_t max_tables = 4;             ///< recognisers for other commands that a worker keeps, besides its own

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Spoken commands in one utterance of S16LE sound. A request's commands that the worker has no recogniser for take as
/// long as loading one; send always the same.
/// @throws std::invalid_argument for options.
ExecutorFactory speechExecutor(const SpeechExecutorOptions& options);

struct PictureSize
{
  uint32_t width = 0;   ///< [px]
  uint32_t height = 0;  ///< [px]
};
/// What the header of a JPEG says, without decoding.
/// @throws std::runtime_error if it is no JPEG, or ends before its size.
PictureSize jpegSize(const std::vector<uint8_t>& jpeg);

/// Commands of a request: one per line, without spaces around them, in lower case; empty lines are left out.
/// @throws std::runtime_error or std::invalid_argument naming what is wrong.
pi_speech::CommandTable commandsOf(const std::string& lines, size_t most);

}  // namespace pi_offload
