#include "recognizer/grammar.h"

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include "recognizer/words.h"

namespace pi_speech
{
std::string toJsgf(const std::vector<std::string>& texts, int in_a_row)
{
  if (in_a_row < 1 || in_a_row > 3)
  {
    throw std::invalid_argument("in_a_row = " + std::to_string(in_a_row) + ", must be in [1, 3]");
  }
  if (texts.empty())
  {
    throw std::invalid_argument("a grammar needs at least one text");
  }
  std::string row = "<text>";
  for (int i = 1; i < in_a_row; ++i)
  {
    row = "<text> [" + row + "]";
  }
  std::string grammar = "#JSGF V1.0;\ngrammar texts;\npublic <utterance> = " + row + ";\n<text> = ";
  for (size_t i = 0; i < texts.size(); ++i)
  {
    grammar += (i == 0 ? "" : " | ") + texts[i];
  }
  return grammar + ";\n";
}

std::vector<std::string> garbageBeside(const CommandTable& table, const std::vector<std::string>& words)
{
  const std::vector<std::string> command_words = table.words();
  std::vector<std::string> garbage;
  for (const std::string& word : words)
  {
    if (!std::binary_search(command_words.begin(), command_words.end(), word) &&
        std::find(garbage.begin(), garbage.end(), word) == garbage.end())
    {
      garbage.push_back(word);
    }
  }
  return garbage;
}

std::vector<std::string> readGarbageWords(const std::string& path)
{
  std::ifstream file(path);
  std::vector<std::string> words;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number)
  {
    const std::string word = normalised(line.substr(0, line.find('#')));
    const std::string place = path + ":" + std::to_string(number) + ": ";
    if (word.empty())
    {
      continue;
    }
    if (word.find(' ') != std::string::npos)
    {
      throw std::runtime_error(place + "\"" + word + "\" is more than one word; write one per line");
    }
    const std::string problem = problemOfWord(word);
    if (!problem.empty())
    {
      throw std::runtime_error(place + "\"" + word + "\" " + problem);
    }
    if (std::find(words.begin(), words.end(), word) != words.end())
    {
      throw std::runtime_error(place + "\"" + word + "\" is there twice; remove one");
    }
    words.push_back(word);
  }
  if (!file.is_open() || file.bad())
  {
    throw std::runtime_error(path +
                             ": the garbage words cannot be read; give the path of a file with one word per line");
  }
  if (words.empty())
  {
    throw std::runtime_error(path + ": there are no garbage words in it; write one per line");
  }
  return words;
}

}  // namespace pi_speech
