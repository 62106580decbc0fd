#pragma once

#include <string>
#include <vector>

namespace pi_speech
{

/// A spoken command.
struct Command
{
  std::string text;                ///< words in lower case with single spaces, as "go left"; published unchanged
  bool fast = false;               ///< published before the pause that ends an utterance
  double threshold = 0.0;          ///< least confidence, in (0, 1]; 0: that of the recogniser
  double network_threshold = 0.0;  ///< the same where the word network hears it; 0: threshold
  double doubt = 0.0;              ///< confidence, below both thresholds, from which the command is doubtful; 0: never
};

/// The commands, in the order of the table.
struct CommandTable
{
  std::vector<Command> commands;

  std::vector<std::string> texts() const;
  /// The distinct words of all commands, sorted.
  std::vector<std::string> words() const;

  /// Reads
  /// @code{.yaml}
  /// commands:
  ///   - stop                              # a text,
  ///   - {text: go left, threshold: 0.4}   # or a map
  ///   - {text: halt, fast: true, threshold: 0.6, doubt: 0.3}
  /// @endcode
  /// Texts are trimmed and brought to lower case.
  /// @throws std::runtime_error naming file, line, what is wrong and the way out: no such file, no YAML, no list
  ///   `commands`, empty, an unknown key, a text twice, without words, or with other characters than letters, digits,
  ///   apostrophes and hyphens in its words; a doubt that is not below a threshold; a fast command that other
  ///   commands begin with ("go" beside "go left").
  static CommandTable load(const std::string& path);
  /// The same from a text. @param name  of the source, in messages.
  static CommandTable parse(const std::string& yaml, const std::string& name);

  /// @throws std::invalid_argument as load().
  void validate() const;
};

}  // namespace pi_speech
