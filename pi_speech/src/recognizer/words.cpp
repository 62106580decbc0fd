#include "recognizer/words.h"

#include <sstream>

namespace pi_speech
{
namespace
{

bool isLetterOrDigit(char c)
{
  return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
}

}  // namespace

std::vector<std::string> splitWords(const std::string& text)
{
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;)
  {
    words.push_back(word);
  }
  return words;
}

std::string normalised(const std::string& text)
{
  std::string result;
  for (const std::string& word : splitWords(text))
  {
    result += (result.empty() ? "" : " ") + word;
  }
  for (char& c : result)
  {
    if (c >= 'A' && c <= 'Z')
    {
      c = static_cast<char>(c - 'A' + 'a');
    }
  }
  return result;
}

std::string problemOfWord(const std::string& word)
{
  bool spoken = false;
  for (const char c : word)
  {
    spoken = spoken || isLetterOrDigit(c);
    if (!isLetterOrDigit(c) && c != '\'' && c != '-')
    {
      const auto code = static_cast<unsigned char>(c);
      const std::string name = code > 32 && code < 127 ? std::string("'") + c + "'" : "of code " + std::to_string(code);
      return "has the character " + name + "; write it with the letters a to z, digits, apostrophes and hyphens";
    }
  }
  return spoken ? "" : "has no letter and no digit; write what is spoken";
}

}  // namespace pi_speech
