#pragma once

#include <pi_speech/command_table.h>

#include <string>
#include <vector>

namespace pi_speech
{

/// The commands as a grammar in JSGF: one of the commands, or, with garbage words, one to most_garbage_words of these.
/// Garbage words are common words that stand for all that is no command; those that are words of a command are left
/// out. Up to three in a row reject more of other speech, and more of the commands too, in twice the time.
/// @param most_garbage_words  in [1, 3]. @throws std::invalid_argument if it is not.
std::string toJsgf(const CommandTable& table, const std::vector<std::string>& garbage_words,
                   int most_garbage_words = 1);

/// Reads a list of garbage words: one per line, # begins a comment.
/// @throws std::runtime_error naming the file and what is wrong.
std::vector<std::string> readGarbageWords(const std::string& path);

}  // namespace pi_speech
