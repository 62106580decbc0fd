#include <pi_speech/grammar.h>

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include "words.h"

namespace pi_speech
{
namespace
{

std::string alternatives(const std::vector<std::string>& texts)
{
  std::string result;
  for (const std::string& text : texts)
  {
    result += (result.empty() ? "" : " | ") + text;
  }
  return result;
}

}  // namespace

std::string toJsgf(const CommandTable& table, const std::vector<std::string>& garbage_words, int most_garbage_words)
{
  if (most_garbage_words < 1 || most_garbage_words > 3)
  {
    throw std::invalid_argument("most_garbage_words = " + std::to_string(most_garbage_words) + ", must be in [1, 3]");
  }
  std::vector<std::string> texts;
  for (const Command& command : table.commands)
  {
    texts.push_back(command.text);
  }
  const std::vector<std::string> command_words = table.words();
  std::vector<std::string> garbage;
  for (const std::string& word : garbage_words)
  {
    if (!std::binary_search(command_words.begin(), command_words.end(), word) &&
        std::find(garbage.begin(), garbage.end(), word) == garbage.end())
    {
      garbage.push_back(word);
    }
  }
  std::string grammar = "#JSGF V1.0;\ngrammar commands;\n";
  if (garbage.empty())
  {
    return grammar + "public <utterance> = " + alternatives(texts) + ";\n";
  }
  grammar += "public <utterance> = <command> | <garbage>;\n";
  grammar += "<command> = " + alternatives(texts) + ";\n";
  std::string others = "<other>";
  for (int i = 1; i < most_garbage_words; ++i)
  {
    others = "<other> [" + others + "]";
  }
  grammar += "<garbage> = " + others + ";\n";
  grammar += "<other> = " + alternatives(garbage) + ";\n";
  return grammar;
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
