#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include "recognizer/pronunciation.h"

#include <algorithm>
#include <clocale>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>

#include "recognizer/test_support.h"

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

class PronunciationTest : public testing::Test
{
protected:
  std::string write(const std::string& content) const
  {
    const std::string path = folder_.path() + "/words.dict";
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }

  static std::string errorOf(const std::string& path, const std::string& word = "", bool guess_words = false)
  {
    try
    {
      Pronunciation pronunciation(path, guess_words);
      if (!word.empty())
      {
        pronunciation.find(word);
      }
      return "";
    }
    catch (const std::runtime_error& error)
    {
      return error.what();
    }
  }

  TemporaryFolder folder_;
};

/// Least number of phones to insert, remove and replace.
size_t distance(const Phones& a, const Phones& b)
{
  std::vector<size_t> row(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j)
  {
    row[j] = j;
  }
  for (size_t i = 1; i <= a.size(); ++i)
  {
    size_t diagonal = row[0];
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j)
    {
      const size_t above = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row[b.size()];
}

TEST_F(PronunciationTest, FindsAllVariantsOfAWord)
{
  Pronunciation pronunciation(write("on AA N\non(2) AO N\nonce W AH N S\n"), false);

  const Pronunciation::Entry entry = pronunciation.find("on");

  EXPECT_EQ((std::vector<Phones>{{"AA", "N"}, {"AO", "N"}}), entry.variants);
  EXPECT_FALSE(entry.guessed);
}

TEST_F(PronunciationTest, TakesCommentsBlankLinesAndOtherLineEnds)
{
  Pronunciation pronunciation(
      write(";;; comment\n## another\n\r\n\t\nGO\t G  OW \r\nx-ray EH K S R EY\n'cause K AH Z\nlast L AE S T"), false);

  EXPECT_EQ((Phones{"G", "OW"}), pronunciation.find("go").variants.at(0));
  EXPECT_EQ((Phones{"EH", "K", "S", "R", "EY"}), pronunciation.find("x-ray").variants.at(0));
  EXPECT_EQ((Phones{"K", "AH", "Z"}), pronunciation.find("'cause").variants.at(0));
  EXPECT_EQ((Phones{"L", "AE", "S", "T"}), pronunciation.find("LAST").variants.at(0));
}

TEST_F(PronunciationTest, ReadsLinesAcrossTheBordersOfItsBlocks)
{
  std::string content;
  for (int i = 0; i < 20000; ++i)
  {
    content += "word" + std::to_string(i) + " W ER D" + (i % 7 == 0 ? " Z" : "") + "\n";
  }
  Pronunciation pronunciation(write(content), false);

  for (int i = 0; i < 20000; ++i)
  {
    const Pronunciation::Entry entry = pronunciation.find("word" + std::to_string(i));
    ASSERT_EQ(1U, entry.variants.size()) << i;
    ASSERT_EQ(i % 7 == 0 ? 4U : 3U, entry.variants[0].size()) << i;
  }
}

TEST_F(PronunciationTest, WritesADictionaryOfItsWords)
{
  Pronunciation pronunciation(write("on AA N\non(2) AO N\ngo G OW\n"), false);

  EXPECT_EQ("go G OW\non AA N\non(2) AO N\n", pronunciation.dictionaryOf({"go", "on"}));
}

TEST_F(PronunciationTest, BadDictionariesAreNamedWithAWayOut)
{
  EXPECT_TRUE(contains(errorOf("/nowhere/words.dict"), "/nowhere/words.dict: "));
  EXPECT_TRUE(contains(errorOf("/nowhere/words.dict"), "install pocketsphinx-en-us"));
  EXPECT_TRUE(contains(errorOf(folder_.path()), "it is no file"));
  EXPECT_TRUE(contains(errorOf(write("")), "there are no words in it"));
  EXPECT_TRUE(contains(errorOf(write("## nothing\n")), "there are no words in it"));
  EXPECT_TRUE(contains(errorOf(write("go G OW\nstop\n")), "words.dict:2: \"stop\" has no phones"));
  EXPECT_TRUE(contains(errorOf(write("go G OW\nstop " + std::string(100000, 'S') + "\n")), "words.dict:2: "));
}

TEST_F(PronunciationTest, AnUnknownWordIsAnErrorWithoutRules)
{
  const std::string path = write("go G OW\n");
  const std::string error = errorOf(path, "zorble");

  EXPECT_TRUE(contains(error, "\"zorble\" is not in the dictionary " + path)) << error;
  EXPECT_TRUE(contains(error, "guess_words")) << error;
}

TEST_F(PronunciationTest, AnUnknownWordIsGuessedByRules)
{
  Pronunciation pronunciation(write("go G OW\n"), true);

  const Pronunciation::Entry entry = pronunciation.find("stopping");

  EXPECT_TRUE(entry.guessed);
  EXPECT_EQ((std::vector<Phones>{{"S", "T", "AA", "P", "IH", "NG"}}), entry.variants);
  EXPECT_EQ("stopping S T AA P IH NG\ngo G OW\n", pronunciation.dictionaryOf({"stopping", "go"}));
  EXPECT_EQ(std::vector<std::string>{"stopping S T AA P IH NG"}, pronunciation.guesses());
}

TEST_F(PronunciationTest, ADictionaryThatIsRemovedLaterStillServes)
{
  const std::string path = write("go G OW\n");
  Pronunciation pronunciation(path, false);
  std::filesystem::remove(path);

  EXPECT_EQ((Phones{"G", "OW"}), pronunciation.find("go").variants.at(0));
}

TEST(GuessPhones, KnowsLettersDigitsAndSigns)
{
  EXPECT_EQ((Phones{"N", "AY", "N"}), guessPhones("9"));
  EXPECT_EQ((Phones{"EH", "K", "S", "R", "EY"}), guessPhones("x-ray"));
  EXPECT_TRUE(guessPhones("").empty());
}

TEST(GuessPhones, LeavesTheLocaleAlone)
{
  const std::string before = setlocale(LC_CTYPE, nullptr);
  guessPhones("water");
  EXPECT_EQ(before, setlocale(LC_CTYPE, nullptr));
}

TEST(GuessPhones, ServesManyThreads)
{
  const Phones alone = guessPhones("wonderful");
  std::vector<Phones> found(4);
  std::vector<std::thread> threads;
  for (Phones& phones : found)
  {
    threads.emplace_back(
        [&phones]
        {
          for (int i = 0; i < 50; ++i)
          {
            guessPhones("other" + std::to_string(i));
            phones = guessPhones("wonderful");
          }
        });
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  for (const Phones& phones : found)
  {
    EXPECT_EQ(alone, phones);
  }
}

TEST(GuessPhonesDeathTest, MissingDataIsAnErrorThatNamesTheWordAndThePackage)
{
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/words.dict";
  std::ofstream(path) << "go G OW\n";
  // In a process of its own, since espeak-ng is initialised once.
  EXPECT_EXIT(
      {
        setenv("ESPEAK_DATA_PATH", folder.path().c_str(), 1);
        try
        {
          Pronunciation(path, true).find("zorble");
        }
        catch (const std::runtime_error& error)
        {
          std::fprintf(stderr, "%s\n", error.what());
          std::exit(7);
        }
        std::exit(0);
      },
      testing::ExitedWithCode(7), "\"zorble\" is not in the dictionary .*install espeak-ng-data");
}

TEST(GuessPhones, AreMostlyThoseOfTheDictionary)
{
  if (!std::filesystem::exists(DICTIONARY))
  {
    GTEST_SKIP() << "no " << DICTIONARY << "; install pocketsphinx-en-us";
  }
  std::vector<std::string> words;
  std::ifstream file(DICTIONARY);
  for (std::string line; std::getline(file, line);)
  {
    const std::string word = line.substr(0, line.find(' '));
    if (word.find('(') == std::string::npos)
    {
      words.push_back(word);
    }
  }
  std::mt19937 random(3);
  std::shuffle(words.begin(), words.end(), random);
  words.resize(2000);
  Pronunciation pronunciation(DICTIONARY, false);
  size_t errors = 0;
  size_t phones = 0;
  std::set<std::string> used;
  for (const std::string& word : words)
  {
    const Phones guessed = guessPhones(word);
    used.insert(guessed.begin(), guessed.end());
    size_t least = guessed.size() + 100;
    size_t length = 0;
    for (const Phones& variant : pronunciation.find(word).variants)
    {
      const size_t wrong = distance(variant, guessed);
      if (wrong < least)
      {
        least = wrong;
        length = variant.size();
      }
    }
    errors += least;
    phones += length;
  }

  // 9.5 % of 20000 words; the deviation of 2000 is below 0.5 %.
  EXPECT_LT(static_cast<double>(errors) / static_cast<double>(phones), 0.12);
  EXPECT_EQ(39U, used.size());
}

}  // namespace
}  // namespace pi_speech
