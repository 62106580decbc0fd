#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include "sphinx/speech_model_check.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>
#include <string>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

namespace fs = std::filesystem;

const std::string DICTIONARY = "go G OW\nstop S T AA P\n";
const std::string GRAMMAR = "#JSGF V1.0;\ngrammar g;\npublic <g> = go | stop;\n";

class SpeechModelCheck : public testing::Test
{
protected:
  void SetUp() override
  {
    if (!fs::exists(SphinxModel().acoustic_model))
    {
      GTEST_SKIP() << "no " << SphinxModel().acoustic_model << "; install pocketsphinx-en-us";
    }
  }

  static std::string errorOf(const SphinxModel& model,
                             const SpeechModelCheckOptions& options = SpeechModelCheckOptions())
  {
    try
    {
      checkSpeechModel(model, DICTIONARY, GRAMMAR, options);
      return "";
    }
    catch (const std::runtime_error& error)
    {
      return error.what();
    }
  }

  /// What is said when the program does this.
  std::string errorWith(const std::string& command, double timeout_s = 30.0) const
  {
    SpeechModelCheckOptions options;
    options.program = folder_.path() + "/program";
    options.timeout_s = timeout_s;
    std::ofstream(options.program) << "#!/bin/sh\n" << command << "\n";
    fs::permissions(options.program, fs::perms::owner_all);
    return errorOf(SphinxModel(), options);
  }

  TemporaryFolder folder_;
};

bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

TEST_F(SpeechModelCheck, AGoodModelPasses)
{
  EXPECT_EQ("", errorOf(SphinxModel()));
  EXPECT_NO_THROW(checkSpeechModelHere(SphinxModel(), DICTIONARY, GRAMMAR));
}

TEST_F(SpeechModelCheck, TheProgramGetsDictionaryAndGrammar)
{
  EXPECT_EQ("", errorWith("cat > " + folder_.path() + "/input"));

  std::ifstream file(folder_.path() + "/input");
  EXPECT_EQ(DICTIONARY + "\n" + GRAMMAR,
            (std::string{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()}));
}

TEST_F(SpeechModelCheck, ACrashIsNamed)
{
  const std::string error = errorWith("kill -SEGV $$");

  EXPECT_EQ(0U, error.find(SphinxModel().acoustic_model + ": PocketSphinx crashes on this model")) << error;
  EXPECT_TRUE(contains(error, "Segmentation fault")) << error;
  EXPECT_TRUE(contains(error, "install it again")) << error;
}

TEST_F(SpeechModelCheck, TheModelIsNotBlamedForAnInterruption)
{
  const std::string error = errorWith("kill -TERM $$");

  EXPECT_TRUE(contains(error, "the check of it was ended from outside (Terminated)")) << error;
  EXPECT_FALSE(contains(error, "damaged")) << error;
}

TEST_F(SpeechModelCheck, TheEndByPocketSphinxIsNamedWithItsLastWords)
{
  const std::string error = errorWith("echo said before; echo 'bio_fread failed' >&2; exit 1");

  EXPECT_TRUE(
      contains(error, SphinxModel().acoustic_model + ": PocketSphinx cannot load this model: bio_fread failed;"))
      << error;
  EXPECT_TRUE(contains(errorWith("exit 1"), "says nothing"));
}

TEST_F(SpeechModelCheck, AReasonOfTheProgramIsTakenAsItIs)
{
  EXPECT_EQ("the reason; the way out", errorWith("echo 'the reason; the way out'; exit 2"));
}

TEST_F(SpeechModelCheck, AProgramThatDoesNotEndIsKilled)
{
  const std::string error = errorWith("exec tail -f /dev/null", 0.2);

  EXPECT_TRUE(contains(error, "took longer than 0.2 s")) << error;
}

TEST_F(SpeechModelCheck, AMissingProgramIsNamedWithAWayOut)
{
  SpeechModelCheckOptions options;
  options.program = folder_.path() + "/none";
  const std::string error = errorOf(SphinxModel(), options);

  EXPECT_TRUE(contains(error, options.program + ": cannot be started")) << error;
  EXPECT_TRUE(contains(error, "switch check_model off")) << error;
}

TEST_F(SpeechModelCheck, TooLittleMemoryIsAnError)
{
  SpeechModelCheckOptions options;
  options.memory_limit_mb = 20;

  EXPECT_NE("", errorOf(SphinxModel(), options));
}

/// Where a binary mdef is cut or changed: each is found before PocketSphinx reads it.
TEST_F(SpeechModelCheck, ADamagedModelDefinitionIsFoundBeforeItIsUsed)
{
  SphinxModel model;
  const std::string source = model.acoustic_model;
  model.acoustic_model = folder_.path() + "/model";
  fs::copy(source, model.acoustic_model, fs::copy_options::recursive);
  std::ifstream file(source + "/mdef", std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  SpeechModelCheckOptions options;
  options.program = folder_.path() + "/must_not_be_started";
  const auto error_with = [&](const std::string& content)
  {
    std::ofstream(model.acoustic_model + "/mdef", std::ios::binary) << content;
    return errorOf(model, options);
  };
  const std::string damaged = model.acoustic_model + "/mdef: this part of the acoustic model is damaged: ";

  for (const size_t size : {size_t{6}, size_t{100}, size_t{1100}, size_t{1300}, whole.size() / 2, whole.size() - 1})
  {
    EXPECT_EQ(0U, error_with(whole.substr(0, size)).find(damaged + "it is too short")) << size;
  }
  std::string changed = whole;
  changed.replace(whole.size() - 2, 2, "\xff\xff");
  EXPECT_EQ(0U, error_with(changed).find(damaged + "a sequence has a state that does not exist"));
  std::mt19937 random(11);
  changed = whole;
  for (size_t i = 0; i < whole.size() / 100; ++i)
  {
    changed[1200 + random() % (whole.size() - 1200)] = static_cast<char>(random());
  }
  EXPECT_EQ(0U, error_with(changed).find(damaged));
}

}  // namespace
}  // namespace pi_speech
