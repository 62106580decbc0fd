#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace pi_speech
{

/// Phones of a word, in the names of the CMU dictionary: "S", "T", "AA", "P".
using Phones = std::vector<std::string>;

/// How words are spoken: a dictionary in the format of CMU (`word(2)  P H O N E S`), and by rules what it lacks.
/// Not thread safe.
class Pronunciation
{
public:
  /// Reads the dictionary.
  /// @param path         of the dictionary.
  /// @param additions    another dictionary, with pronunciations besides those; empty: none.
  /// @param guess_words  words that are not in it are pronounced by the rules of espeak-ng; else they are errors.
  /// @throws std::runtime_error naming the file and what is wrong: missing, empty, a line without phones.
  Pronunciation(const std::string& path, bool guess_words, const std::string& additions = "");
  ~Pronunciation();

  struct Entry
  {
    std::vector<Phones> variants;
    bool guessed = false;  ///< by rules: no dictionary has the word
  };

  /// @throws std::runtime_error naming word, dictionary and way out, if there is no pronunciation.
  Entry find(const std::string& word);

  /// The words with all their variants as lines of a dictionary.
  std::string dictionaryOf(const std::vector<std::string>& words);

  /// The words asked for so far that are guessed, as lines of a dictionary: "zorble Z AO R B AH L".
  std::vector<std::string> guesses() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// espeak-ng's phones for a word in American English as phones of the CMU dictionary. Empty if it has none.
/// Thread safe; espeak-ng itself is used by one thread at a time.
Phones guessPhones(const std::string& word);

}  // namespace pi_speech
