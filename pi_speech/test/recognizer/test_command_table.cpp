#include <gtest/gtest.h>
#include <pi_speech/command_table.h>

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "recognizer/test_support.h"

namespace pi_speech
{
namespace
{

std::string errorOf(const std::string& yaml)
{
  try
  {
    CommandTable::parse(yaml, "table.yaml");
    return "";
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
}

std::string errorOf(const CommandTable& table)
{
  try
  {
    table.validate();
    return "";
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
}

TEST(CommandTable, ReadsTextsAndMapsInTheirOrder)
{
  const CommandTable table = CommandTable::parse(
      "commands:\n  - go\n  - {text: go left, threshold: 0.4}\n"
      "  - {text: halt, fast: true, threshold: 0.6, network_threshold: 0.7, doubt: 0.3}\n",
      "table.yaml");

  ASSERT_EQ(3U, table.commands.size());
  EXPECT_EQ("go", table.commands[0].text);
  EXPECT_FALSE(table.commands[0].fast);
  EXPECT_EQ(0.0, table.commands[0].threshold);
  EXPECT_EQ("go left", table.commands[1].text);
  EXPECT_EQ(0.4, table.commands[1].threshold);
  EXPECT_EQ(0.0, table.commands[1].network_threshold);
  EXPECT_EQ(0.0, table.commands[1].doubt);
  EXPECT_EQ(0.7, table.commands[2].network_threshold);
  EXPECT_EQ(0.3, table.commands[2].doubt);
  EXPECT_EQ("halt", table.commands[2].text);
  EXPECT_TRUE(table.commands[2].fast);
}

TEST(CommandTable, BringsTextsToLowerCaseAndOneSpace)
{
  const CommandTable table = CommandTable::parse("commands: ['  Go \t LEFT ', \"don't x-ray 9\"]", "table.yaml");

  EXPECT_EQ("go left", table.commands[0].text);
  EXPECT_EQ("don't x-ray 9", table.commands[1].text);
}

TEST(CommandTable, TakesWordsThatYamlReadsAsTruthValues)
{
  const CommandTable table = CommandTable::parse("commands: [yes, no, on, {text: off}]", "table.yaml");

  EXPECT_EQ("yes", table.commands[0].text);
  EXPECT_EQ("no", table.commands[1].text);
  EXPECT_EQ("on", table.commands[2].text);
  EXPECT_EQ("off", table.commands[3].text);
}

TEST(CommandTable, GivesTheDistinctWordsSorted)
{
  const CommandTable table = CommandTable::parse("commands: [turn right, go right, go]", "table.yaml");

  EXPECT_EQ((std::vector<std::string>{"go", "right", "turn"}), table.words());
}

TEST(CommandTable, NamesFileLineAndWayOut)
{
  struct Case
  {
    std::string yaml;
    std::string place;
    std::string part;
  };
  const std::vector<Case> cases = {
      {"", "table.yaml: ", "there is no list \"commands\""},
      {"- go\n", "table.yaml:1: ", "there is no list \"commands\""},
      {"commands:\n", "table.yaml:", "\"commands\" is empty"},
      {"commands: []\n", "table.yaml:1: ", "\"commands\" is empty"},
      {"commands: go\n", "table.yaml:1: ", "\"commands\" is no list"},
      {"commands: [go]\nname: x\n", "table.yaml:2: ", "unknown key \"name\""},
      {"commands:\n  - go\n  - stop\n  - Go\n", "table.yaml:4: ", "\"go\" is there twice"},
      {"commands:\n  - go\n  - \"  \"\n", "table.yaml:3: ", "without words"},
      {"commands:\n  - go\n  -\n", "table.yaml:", "without words"},
      {"commands:\n  - go\n  - [left]\n", "table.yaml:3: ", "must be a text, or a map"},
      {"commands:\n  - go!\n", "table.yaml:2: ", "\"go!\" has the character '!'"},
      {"commands:\n  - st\xc3\xb6p\n", "table.yaml:2: ", "of code 195"},
      {"commands:\n  - go -\n", "table.yaml:2: ", "\"-\" has no letter"},
      {"commands:\n  - {text: go, speed: 1}\n", "table.yaml:2: ", "unknown key \"speed\""},
      {"commands:\n  - {fast: true}\n", "table.yaml:2: ", "without \"text\""},
      {"commands:\n  - {text: go, fast: 7}\n", "table.yaml:2: ", "fast = 7, must be true or false"},
      {"commands:\n  - {text: go, threshold: high}\n", "table.yaml:2: ", "threshold = high, must be a number"},
      {"commands:\n  - {text: go, threshold: 1.5}\n", "table.yaml:2: ", "threshold = 1.5, must be in (0, 1]"},
      {"commands:\n  - {text: go, network_threshold: 2}\n",
       "table.yaml:2: ", "network_threshold = 2, must be in (0, 1]"},
      {"commands:\n  - {text: go, threshold: 0.5, network_threshold: 0.4, doubt: 0.4}\n",
       "table.yaml:2: ", "doubt = 0.4, must be in (0, 0.4)"},
      {"commands:\n  - {text: go, doubt: much}\n", "table.yaml:2: ", "doubt = much, must be a number"},
      {"commands:\n  - {text: go, doubt: 1}\n", "table.yaml:2: ", "doubt = 1, must be in (0, 1), below the threshold"},
      {"commands:\n  - {text: go, threshold: 0.5, doubt: 0.5}\n", "table.yaml:2: ", "doubt = 0.5, must be in (0, 0.5)"},
      {"commands:\n  - {text: go, threshold: .nan}\n", "table.yaml:2: ", "must be in (0, 1]"},
      {"commands:\n  - {text: go, text: stop}\n", "table.yaml:2: ", "key \"text\" is there twice"},
      {"commands:\n  - go left\n  - {text: go, fast: true}\n", "table.yaml:3: ", "\"go left\" begins with it"},
      {"commands:\n  - [go\n", "table.yaml:", "no YAML that can be read"},
  };
  for (const Case& bad : cases)
  {
    const std::string error = errorOf(bad.yaml);
    EXPECT_EQ(0U, error.find(bad.place)) << bad.yaml << error;
    EXPECT_TRUE(contains(error, bad.part)) << bad.yaml << error;
  }
}

TEST(CommandTable, AFastCommandMayBeginWithTheLettersOfAnother)
{
  EXPECT_EQ("", errorOf("commands: [{text: go, fast: true}, goal, {text: stop, fast: true}]"));
}

TEST(CommandTable, AMissingFileIsNamed)
{
  try
  {
    CommandTable::load("/nowhere/commands.yaml");
    FAIL();
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_TRUE(contains(error.what(), "/nowhere/commands.yaml: ")) << error.what();
    EXPECT_TRUE(contains(error.what(), "give the path")) << error.what();
  }
}

TEST(CommandTable, AFolderIsNoTable)
{
  EXPECT_THROW(CommandTable::load(std::filesystem::temp_directory_path().string()), std::runtime_error);
}

TEST(CommandTable, ValidatesWhatWasNotReadFromAFile)
{
  CommandTable table;
  EXPECT_TRUE(contains(errorOf(table), "commands is empty"));

  table.commands = {{"go", false, 0.0}, {"Stop", false, 0.0}};
  EXPECT_TRUE(contains(errorOf(table), "commands[1]: command \"Stop\" must be in lower case")) << errorOf(table);

  table.commands[1] = {"stop", false, -0.5};
  EXPECT_TRUE(contains(errorOf(table), "threshold = -0.5")) << errorOf(table);

  table.commands[1] = {"stop", true, 1.0};
  EXPECT_EQ("", errorOf(table));
}

TEST(CommandTable, TheTablesOfThePackageAreGood)
{
  const CommandTable single = CommandTable::load(std::string(PI_SPEECH_CONFIG) + "/commands.yaml");
  const CommandTable phrases = CommandTable::load(std::string(PI_SPEECH_CONFIG) + "/commands_phrases.yaml");

  EXPECT_EQ(10U, single.words().size());
  EXPECT_EQ(13U, phrases.commands.size());
  EXPECT_TRUE(single.commands.front().fast);
  EXPECT_EQ("stop", single.commands.front().text);
}

}  // namespace
}  // namespace pi_speech
