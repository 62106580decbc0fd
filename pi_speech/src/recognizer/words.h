#pragma once

#include <string>
#include <vector>

namespace pi_speech
{

/// The text in lower case, without blanks at its ends and with one space between two words.
std::string normalised(const std::string& text);

/// The words of a normalised text.
std::vector<std::string> splitWords(const std::string& text);

/// What is wrong with a word ("has the character '%'; ..."), or empty: letters, digits, apostrophes and hyphens, and
/// one letter or digit at least.
std::string problemOfWord(const std::string& word);

}  // namespace pi_speech
