#pragma once

#include <pi_speech/command_table.h>

#include <string>
#include <vector>

namespace pi_speech
{

/// A grammar in JSGF: one of the texts or, with more in a row, up to so many, whatever their order.
/// @param in_a_row  in [1, 3]. @throws std::invalid_argument if it is not, or without a text.
std::string toJsgf(const std::vector<std::string>& texts, int in_a_row = 1);

/// The words that stand for other speech beside a table: those that are no word of a command.
std::vector<std::string> garbageBeside(const CommandTable& table, const std::vector<std::string>& words);

/// Reads a list of garbage words: one per line, # begins a comment.
/// @throws std::runtime_error naming the file and what is wrong.
std::vector<std::string> readGarbageWords(const std::string& path);

}  // namespace pi_speech
