// Runs the program schedule_etc, whose path is compiled in as PI_RUNTIME_SCHEDULE_ETC.

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>

namespace
{

struct Result
{
  int status = -1;
  std::string output;  ///< standard output and error together
};

/// @param pipeline what the shell runs, with the program as `$TOOL`.
Result runShell(const std::string& pipeline)
{
  Result result;
  const std::string command = "exec 2>&1; TOOL='" PI_RUNTIME_SCHEDULE_ETC "'; " + pipeline;
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr)
  {
    ADD_FAILURE() << "popen failed";
    return result;
  }
  std::array<char, 4096> buffer{};
  for (size_t size = 0; (size = fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
  {
    result.output.append(buffer.data(), size);
  }
  const int status = pclose(pipe);
  result.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return result;
}

class ScheduleEtc : public ::testing::Test
{
protected:
  ScheduleEtc() : prefix_(::testing::TempDir() + "/test_schedule_etc_" + std::to_string(::getpid())) {}
  ~ScheduleEtc() override
  {
    for (const char* name : {"etc", "energy", "out"})
    {
      std::remove(path(name).c_str());
    }
  }

  std::string path(const std::string& name) const { return prefix_ + "_" + name + ".csv"; }

  std::string write(const std::string& name, const std::string& text) const
  {
    std::ofstream(path(name)) << text;
    return path(name);
  }

private:
  std::string prefix_;
};

TEST_F(ScheduleEtc, PrintsWhenEachTaskRunsWhere)
{
  const Result result = runShell("$TOOL " + write("etc", "cpu,gpu\n4,5\n4,5\n1,9\n") + " --policy mct --available 0,1");
  EXPECT_EQ(0, result.status);
  EXPECT_EQ(
      "task,unit,start,finish\n0,0,0,4\n1,1,1,6\n2,0,4,5\n"
      "# makespan 6\n# load 0 5\n# load 1 6\n# energy 0\n# objective 6\n",
      result.output);
}

TEST_F(ScheduleEtc, ReadsStandardInputAndSearchesByDefault)
{
  const Result result = runShell("printf '2,2\\n2,2\\n4,4\\n' | $TOOL - --budget-us 0");
  EXPECT_EQ(0, result.status);
  EXPECT_NE(std::string::npos, result.output.find("# makespan 4\n")) << result.output;
  EXPECT_NE(std::string::npos, result.output.find("# lower_bound 4 (optimal)\n")) << result.output;
}

TEST_F(ScheduleEtc, WeighsEnergyAndWritesAFile)
{
  const Result result = runShell("$TOOL " + write("etc", "1,3\n") + " --energy " + write("energy", "20,2\n") +
                                 " --alpha 2 --gamma 1 --output " + path("out"));
  EXPECT_EQ(0, result.status);
  EXPECT_EQ("", result.output);
  std::stringstream file;
  file << std::ifstream(path("out")).rdbuf();
  EXPECT_EQ(
      "task,unit,start,finish\n0,1,0,3\n# makespan 3\n# load 0 0\n# load 1 3\n# energy 2\n# objective 8\n"
      "# lower_bound 8 (optimal)\n",
      file.str());
}

TEST_F(ScheduleEtc, ReportsRefusedTasksWithStatus3)
{
  const Result result = runShell("$TOOL " + write("etc", "inf,inf\n1,inf\n") + " --policy min_min");
  EXPECT_EQ(3, result.status);
  EXPECT_EQ(
      "task,unit,start,finish\n1,0,0,1\n0,refused,,\n"
      "# makespan 1\n# load 0 1\n# load 1 0\n# energy 0\n# objective 1\n",
      result.output);
}

TEST_F(ScheduleEtc, AnswersBadInputWithOneLineAndStatus2)
{
  const std::string etc = write("etc", "1,2\n3,4\n");
  const std::string energy = write("energy", "1,2\n3\n");
  const auto expectRefusal = [](const std::string& pipeline, const std::string& line)
  {
    const Result result = runShell(pipeline);
    EXPECT_EQ(2, result.status) << pipeline;
    EXPECT_EQ("schedule_etc: " + line + "\n", result.output) << pipeline;
  };
  expectRefusal("$TOOL", "no file given, expected a CSV file of execution times or - for standard input");
  expectRefusal("$TOOL /nonexistent.csv", "/nonexistent.csv: No such file or directory");
  expectRefusal("$TOOL " + energy, energy + ": line 2 \"3\": expected 2 fields as before, found 1");
  expectRefusal("$TOOL " + etc + " --energy " + energy,
                energy + ": line 2 \"3\": expected 2 fields as before, found 1");
  expectRefusal("echo '1,-2' | $TOOL -",
                "ETC matrix: task 0 on unit 1 = -2, must be > 0 (inf: the task cannot run there)");
  expectRefusal("$TOOL - < /dev/null", "-: no tasks, expected a line of numbers for each");
  expectRefusal("$TOOL " + etc + " --policy best",
                "policy = \"best\", must be one of diff_min min_min max_min sufferage mct met olb heft_rank search");
  expectRefusal("$TOOL " + etc + " --available 1,x",
                "line 1 \"1,x\": expected numbers or inf separated by commas, not \"x\"");
  expectRefusal("$TOOL " + etc + " --available x",
                "available = \"x\", expected one number per unit, separated by commas");
  expectRefusal("$TOOL " + etc + " --available 1,2,3",
                "available: number of entries = 3, must be that of the units, 2");
  expectRefusal("$TOOL " + etc + " --kicks -3", "kicks = -3, must be >= 0");
  expectRefusal("$TOOL " + etc + " --output /nonexistent/out.csv",
                "output = \"/nonexistent/out.csv\" cannot be written, expected a writable file");
}

TEST_F(ScheduleEtc, AnswersUnknownOptionsWithStatus2AndHelpWithStatus0)
{
  const Result unknown = runShell("$TOOL - --nosuch 3");
  EXPECT_EQ(2, unknown.status);
  EXPECT_NE(std::string::npos, unknown.output.find("--nosuch")) << unknown.output;
  const Result help = runShell("$TOOL --help");
  EXPECT_EQ(0, help.status);
  EXPECT_NE(std::string::npos, help.output.find("--diff-min-order")) << help.output;
}

}  // namespace
