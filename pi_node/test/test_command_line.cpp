#include <gtest/gtest.h>
#include <pi_node/command_line.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace pi_node
{
namespace
{

struct Line
{
  int seed = 7;
  bool quiet = false;
  std::string output;
  std::vector<std::string> inputs;
};

/// @return what parse() returns.
bool parse(const std::vector<std::string>& words, Line* line, bool* seed_given = nullptr)
{
  CommandLine command_line("tool OUTPUT INPUT... [options]");
  command_line.addValue("seed,s", &line->seed, "of the noise");
  command_line.addFlag("quiet", &line->quiet, "no progress");
  command_line.addPositional("output", &line->output, "no output is named");
  command_line.addPositional("inputs", &line->inputs, "no input is named");
  const bool run = command_line.parse(words);
  if (seed_given != nullptr)
  {
    *seed_given = command_line.given("seed");
  }
  return run;
}

TEST(CommandLine, SetsOptionsAndPositionalArguments)
{
  Line line;
  bool seed_given = false;
  EXPECT_TRUE(parse({"out", "a", "--quiet", "b", "-s", "3"}, &line, &seed_given));
  EXPECT_EQ(3, line.seed);
  EXPECT_TRUE(seed_given);
  EXPECT_TRUE(line.quiet);
  EXPECT_EQ("out", line.output);
  EXPECT_EQ((std::vector<std::string>{"a", "b"}), line.inputs);
}

TEST(CommandLine, KeepsDefaults)
{
  Line line;
  bool seed_given = true;
  EXPECT_TRUE(parse({"out", "a"}, &line, &seed_given));
  EXPECT_EQ(7, line.seed);
  EXPECT_FALSE(seed_given);
  EXPECT_FALSE(line.quiet);
}

TEST(CommandLine, NamesTheMissingArgument)
{
  Line line;
  try
  {
    parse({"out"}, &line);
    FAIL() << "nothing was thrown";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ("no input is named", error.what());
  }
}

TEST(CommandLine, HelpNeedsNoArguments)
{
  Line line;
  testing::internal::CaptureStdout();
  EXPECT_FALSE(parse({"--help"}, &line));
  const std::string text = testing::internal::GetCapturedStdout();
  EXPECT_EQ(0U, text.find("tool OUTPUT INPUT... [options]"));
  EXPECT_NE(std::string::npos, text.find("-s [ --seed ] arg (=7)"));
  EXPECT_EQ(std::string::npos, text.find("inputs"));
}

TEST(RunTool, ReturnsTheStatusOfTheRun)
{
  EXPECT_EQ(5, runTool(
                   "tool", [] { return true; }, [] { return 5; }));
  EXPECT_EQ(0, runTool(
                   "tool", [] { return false; }, [] { return 5; }));
}

TEST(RunTool, MakesOneLineOfAnException)
{
  testing::internal::CaptureStderr();
  EXPECT_EQ(2, runTool(
                   "tool", []() -> bool { throw boost::program_options::error("--seed = x"); }, [] { return 0; }));
  EXPECT_EQ("tool: --seed = x; see --help\n", testing::internal::GetCapturedStderr());

  testing::internal::CaptureStderr();
  EXPECT_EQ(1, runTool(
                   "tool", [] { return true; }, []() -> int { throw std::runtime_error("file is gone"); }));
  EXPECT_EQ("tool: file is gone\n", testing::internal::GetCapturedStderr());
}

}  // namespace
}  // namespace pi_node
