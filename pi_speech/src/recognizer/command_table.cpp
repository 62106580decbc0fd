#include <pi_speech/command_table.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "recognizer/words.h"

namespace pi_speech
{
namespace
{

struct Problem
{
  size_t command;  ///< index in the table
  std::string text;
};

bool beginsWith(const std::string& text, const std::string& words)
{
  return text.size() > words.size() && text.compare(0, words.size(), words) == 0 && text[words.size()] == ' ';
}

std::string problemOfText(const std::string& text)
{
  if (text.empty())
  {
    return "a command without words; write what is spoken, or remove it";
  }
  if (text != normalised(text))
  {
    return "command \"" + text + "\" must be in lower case, with one space between two words";
  }
  for (const std::string& word : splitWords(text))
  {
    const std::string problem = problemOfWord(word);
    if (!problem.empty())
    {
      return "command \"" + text + "\": \"" + word + "\" " + problem;
    }
  }
  return "";
}

std::string problemOfThresholds(const Command& command)
{
  std::ostringstream text;
  text << "command \"" << command.text << "\": ";
  double lowest = 1.0;
  for (const auto& [key, value] :
       {std::make_pair("threshold", command.threshold), std::make_pair("network_threshold", command.network_threshold)})
  {
    if (!(value >= 0.0 && value <= 1.0))
    {
      text << key << " = " << value << ", must be in (0, 1], or 0 for that of the recogniser";
      return text.str();
    }
    lowest = value > 0.0 ? std::min(lowest, value) : lowest;
  }
  if (!(command.doubt >= 0.0 && command.doubt < lowest))
  {
    text << "doubt = " << command.doubt << ", must be in (0, " << lowest << "), below the threshold, or 0 for never";
    return text.str();
  }
  return "";
}

std::optional<Problem> firstProblem(const std::vector<Command>& commands)
{
  std::set<std::string> texts;
  for (size_t i = 0; i < commands.size(); ++i)
  {
    const Command& command = commands[i];
    const std::string problem = problemOfText(command.text);
    if (!problem.empty())
    {
      return Problem{i, problem};
    }
    if (!texts.insert(command.text).second)
    {
      return Problem{i, "command \"" + command.text + "\" is there twice; remove one"};
    }
    const std::string threshold_problem = problemOfThresholds(command);
    if (!threshold_problem.empty())
    {
      return Problem{i, threshold_problem};
    }
  }
  for (size_t i = 0; i < commands.size(); ++i)
  {
    for (const Command& other : commands)
    {
      if (commands[i].fast && beginsWith(other.text, commands[i].text))
      {
        return Problem{i, "command \"" + commands[i].text + "\" is fast, but \"" + other.text +
                              "\" begins with it and could never be recognised; set fast to false, or rename one"};
      }
    }
  }
  return std::nullopt;
}

/// Reads a table and knows where in the text each part of it stands.
class TableReader
{
public:
  explicit TableReader(const std::string& name) : name_(name) {}

  CommandTable read(const YAML::Node& root)
  {
    const std::string way_out = "; write \"commands:\" and below it one command per line as \"- stop\"";
    if (!root.IsMap() || !root["commands"].IsDefined())
    {
      fail(root, "there is no list \"commands\"" + way_out);
    }
    for (const auto& entry : root)
    {
      if (entry.first.as<std::string>() != "commands")
      {
        fail(entry.first, "unknown key \"" + entry.first.as<std::string>() + "\"; there is only \"commands\"");
      }
    }
    const YAML::Node list = root["commands"];
    if (!list.IsSequence() || list.size() == 0)
    {
      fail(list,
           std::string("\"commands\" is ") + (list.IsSequence() || list.IsNull() ? "empty" : "no list") + way_out);
    }
    CommandTable table;
    for (const YAML::Node& entry : list)
    {
      table.commands.push_back(entry.IsMap() ? fromMap(entry) : fromText(entry));
    }
    const std::optional<Problem> problem = firstProblem(table.commands);
    if (problem)
    {
      fail(list[problem->command], problem->text);
    }
    return table;
  }

private:
  [[noreturn]] void fail(const YAML::Node& where, const std::string& what) const
  {
    const YAML::Mark mark = where.Mark();
    throw std::runtime_error(name_ + (mark.is_null() ? "" : ":" + std::to_string(mark.line + 1)) + ": " + what);
  }

  Command fromText(const YAML::Node& node) const
  {
    if (!node.IsScalar())
    {
      fail(node, node.IsNull() ? "a command without words; write what is spoken, or remove it"
                               : "a command must be a text, or a map {text: ..., fast: ..., threshold: ..., "
                                 "network_threshold: ..., doubt: ...}");
    }
    Command command;
    command.text = normalised(node.Scalar());
    return command;
  }

  Command fromMap(const YAML::Node& node) const
  {
    Command command;
    std::set<std::string> keys;
    for (const auto& entry : node)
    {
      const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
      if (!keys.insert(key).second)
      {
        fail(entry.first, "key \"" + key + "\" is there twice");
      }
      if (key == "text")
      {
        command.text = fromText(entry.second).text;
      }
      else if (key == "fast")
      {
        command.fast = valueOf<bool>(entry.second, "fast", "true or false");
      }
      else if (key == "threshold")
      {
        command.threshold = valueOf<double>(entry.second, "threshold", "a number in (0, 1]");
      }
      else if (key == "network_threshold")
      {
        command.network_threshold = valueOf<double>(entry.second, "network_threshold", "a number in (0, 1]");
      }
      else if (key == "doubt")
      {
        command.doubt = valueOf<double>(entry.second, "doubt", "a number in (0, 1)");
      }
      else
      {
        fail(entry.first,
             "unknown key \"" + key + "\" of a command; there are text, fast, threshold, network_threshold and doubt");
      }
    }
    if (keys.count("text") == 0)
    {
      fail(node, "a command without \"text\"; write {text: ...} with what is spoken");
    }
    return command;
  }

  template <typename T>
  T valueOf(const YAML::Node& node, const std::string& key, const std::string& wanted) const
  {
    T value{};
    if (!node.IsScalar() || !YAML::convert<T>::decode(node, value))
    {
      fail(node, key + (node.IsScalar() ? " = " + node.Scalar() : "") + ", must be " + wanted);
    }
    return value;
  }

  const std::string name_;
};

}  // namespace

std::vector<std::string> CommandTable::texts() const
{
  std::vector<std::string> texts;
  for (const Command& command : commands)
  {
    texts.push_back(command.text);
  }
  return texts;
}

std::vector<std::string> CommandTable::words() const
{
  std::set<std::string> words;
  for (const Command& command : commands)
  {
    const std::vector<std::string> of_command = splitWords(command.text);
    words.insert(of_command.begin(), of_command.end());
  }
  return {words.begin(), words.end()};
}

CommandTable CommandTable::load(const std::string& path)
{
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  if (!file.is_open() || file.bad())
  {
    throw std::runtime_error(
        path + ": the table of commands cannot be read; give the path of a YAML file with a list " + "\"commands\"");
  }
  return parse(text, path);
}

CommandTable CommandTable::parse(const std::string& yaml, const std::string& name)
{
  try
  {
    return TableReader(name).read(YAML::Load(yaml));
  }
  catch (const YAML::Exception& error)
  {
    throw std::runtime_error(name + (error.mark.is_null() ? "" : ":" + std::to_string(error.mark.line + 1)) +
                             ": no YAML that can be read: " + error.msg + "; correct it there");
  }
}

void CommandTable::validate() const
{
  if (commands.empty())
  {
    throw std::invalid_argument("commands is empty; give one at least");
  }
  const std::optional<Problem> problem = firstProblem(commands);
  if (problem)
  {
    throw std::invalid_argument("commands[" + std::to_string(problem->command) + "]: " + problem->text);
  }
}

}  // namespace pi_speech
