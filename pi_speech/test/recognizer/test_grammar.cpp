#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include "recognizer/grammar.h"
#include "recognizer/pronunciation.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <stdexcept>
#include <string>

#include "recognizer/test_support.h"

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

std::string garbageWordsError(const std::string& content)
{
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/words.txt";
  std::ofstream(path) << content;
  try
  {
    readGarbageWords(path);
    return "";
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
}

TEST(Grammar, HasOneTextOrMoreInARow)
{
  const std::string begin = "#JSGF V1.0;\ngrammar texts;\npublic <utterance> = ";
  const std::string end = ";\n<text> = go left | stop;\n";
  const std::vector<std::string> texts = {"go left", "stop"};

  EXPECT_EQ(begin + "<text>" + end, toJsgf(texts));
  EXPECT_EQ(begin + "<text> [<text>]" + end, toJsgf(texts, 2));
  EXPECT_EQ(begin + "<text> [<text> [<text>]]" + end, toJsgf(texts, 3));
  EXPECT_THROW(toJsgf(texts, 0), std::invalid_argument);
  EXPECT_THROW(toJsgf(texts, 4), std::invalid_argument);
  EXPECT_THROW(toJsgf({}), std::invalid_argument);
}

TEST(Grammar, WordsOfACommandAreNoGarbage)
{
  EXPECT_EQ((std::vector<std::string>{"water", "with"}),
            garbageBeside(table("go left, stop"), {"left", "water", "go", "water", "with"}));
  EXPECT_TRUE(garbageBeside(table("go"), {"go"}).empty());
}

TEST(Grammar, GarbageWordsAreReadWithComments)
{
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/words.txt";
  std::ofstream(path) << "# common words\n\nWater  # one\n  with\r\nx-ray\n";

  EXPECT_EQ((std::vector<std::string>{"water", "with", "x-ray"}), readGarbageWords(path));
}

TEST(Grammar, BadGarbageWordsAreNamedWithTheirLine)
{
  EXPECT_TRUE(contains(garbageWordsError("water\ntwo words\n"), "words.txt:2: \"two words\" is more than one word"));
  EXPECT_TRUE(contains(garbageWordsError("water\n<sil>\n"), "words.txt:2: \"<sil>\" has the character '<'"));
  EXPECT_TRUE(contains(garbageWordsError("water\n\nWater\n"), "words.txt:3: \"water\" is there twice"));
  EXPECT_TRUE(contains(garbageWordsError("# nothing\n"), "there are no garbage words"));
  EXPECT_THROW(readGarbageWords("/nowhere/words.txt"), std::runtime_error);
}

TEST(Grammar, TheGarbageWordsOfThePackageHaveAllCommonPhones)
{
  if (!std::filesystem::exists(DICTIONARY))
  {
    GTEST_SKIP() << "no " << DICTIONARY << "; install pocketsphinx-en-us";
  }
  const std::vector<std::string> words = readGarbageWords(std::string(PI_SPEECH_CONFIG) + "/garbage_words.txt");
  Pronunciation pronunciation(DICTIONARY, false);
  std::set<std::string> phones;
  size_t longest = 0;
  size_t shortest = 100;
  for (const std::string& word : words)
  {
    const Phones of_word = pronunciation.find(word).variants.front();
    phones.insert(of_word.begin(), of_word.end());
    longest = std::max(longest, of_word.size());
    shortest = std::min(shortest, of_word.size());
  }

  EXPECT_EQ(305U, words.size());
  phones.insert("ZH");  // "measure": too rare for the most frequent words
  EXPECT_EQ(39U, phones.size());
  EXPECT_EQ(2U, shortest);  // "two"
  EXPECT_GE(longest, 7U);
}

}  // namespace
}  // namespace pi_speech
