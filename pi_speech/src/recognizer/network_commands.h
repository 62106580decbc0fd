#pragma once

#include <pi_speech/command_recognizer.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "network/word_spotter.h"

namespace pi_speech
{

/// The commands of a table that a WordNetwork hears: some in the stream, wherever they are said, and all of them in
/// single pieces of sound. Commands of one word that it knows are left to it, unless the word is also part of a longer
/// command that is not fast. Without a network it hears nothing. Not thread safe.
class NetworkCommands
{
public:
  /// A command in the stream.
  struct Heard
  {
    size_t command = 0;  ///< in the table
    double confidence = 0.0;
    int64_t begin = 0;  ///< [samples of the stream]
    int64_t end = 0;
    bool doubtful = false;  ///< its confidence is below the threshold, but not below the command's doubt
  };
  using Sink = std::function<void(const Heard& heard)>;
  struct Best
  {
    size_t command = 0;
    double confidence = 0.0;
  };

  /// @throws WordNetworkError
  NetworkCommands(const RecognizerOptions& options, const CommandTable& table);

  size_t count() const { return commands_.size(); }
  bool hears(size_t command) const { return contains(commands_, command); }
  bool hearsInStream(size_t command) const { return contains(in_stream_, command); }
  const std::vector<size_t>& inStream() const { return in_stream_; }

  /// Hears the stream, if it hears any command there.
  void process(const int16_t* samples, size_t count, const Sink& sink);
  /// Forgets the sound before; a command that is nearly heard is told. @param next_sample  number of the next one.
  void restart(int64_t next_sample, const Sink& sink);
  /// The command that it hears best in a single piece of sound, however faint.
  std::optional<Best> listenToPiece(const int16_t* samples, size_t count);

private:
  Heard toHeard(const WordSpotter::Spotted& found) const;
  static bool contains(const std::vector<size_t>& commands, size_t command);

  std::vector<size_t> commands_;       ///< of the table
  std::vector<size_t> in_stream_;      ///< those that need no pause
  std::optional<WordSpotter> stream_;  ///< none: it hears no command there
  std::optional<WordSpotter> single_;
};

}  // namespace pi_speech
