#pragma once

#include <pi_detect/detector.h>
#include <pi_speech/command_recognizer.h>

#include <cstdint>
#include <string>
#include <vector>

#include "server/edge_server.h"

namespace pi_offload
{

// The tasks of a node, done by the same detector and recogniser as on the vehicle. They need OpenCV and PocketSphinx
// and are therefore a library of their own (pi_offload_executors).

struct DetectionExecutorOptions
{
  std::string model;                    ///< YAML file of a network for pi_detect
  pi_detect::DetectorOptions detector;  ///< `threads` is for the whole process; use 1 with several workers
  uint32_t max_side = 8192;             ///< of pictures [px]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Detects objects in JPEG, BGR8, RGB8 and MONO8 pictures. Only the first executor checks the model.
/// @throws std::invalid_argument for options, pi_detect::ModelError for the model.
ExecutorFactory detectionExecutor(const DetectionExecutorOptions& options);

struct SpeechExecutorOptions
{
  pi_speech::RecognizerOptions recognizer;
  pi_speech::CommandTable commands;  ///< for requests without commands
  double max_sound_s = 10.0;         ///< of a request
  size_t max_commands = 200;         ///< of a request
  size_t max_tables = 4;             ///< recognisers for other commands, kept by each worker

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Recognises spoken commands in one utterance of S16LE sound. New commands in a request load a recogniser first, so a
/// vehicle should always send the same ones.
/// @throws std::invalid_argument for options.
ExecutorFactory speechExecutor(const SpeechExecutorOptions& options);

struct PictureSize
{
  uint32_t width = 0;   ///< [px]
  uint32_t height = 0;  ///< [px]
};
/// Size by the header of a JPEG, without decoding.
/// @throws std::runtime_error if it is no JPEG or has no size.
PictureSize jpegSize(const std::vector<uint8_t>& jpeg);

/// Commands of a request, one per line: trimmed, in lower case, without empty lines.
/// @throws std::runtime_error or std::invalid_argument naming what is wrong.
pi_speech::CommandTable commandsOf(const std::string& lines, size_t most);

}  // namespace pi_offload
