#include <gtest/gtest.h>
#include <pi_node/child_process.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <stdexcept>
#include <string>

namespace pi_node
{
namespace
{

ChildResult shell(const std::string& command, const ChildOptions& options = ChildOptions())
{
  return runChild("/bin/sh", {"-c", command}, options);
}

TEST(ChildProcess, GivesStatusAndOutput)
{
  const ChildResult result = shell("echo one; echo two >&2; exit 3");

  EXPECT_TRUE(result.in_time);
  ASSERT_TRUE(WIFEXITED(result.status));
  EXPECT_EQ(3, WEXITSTATUS(result.status));
  EXPECT_EQ("one\ntwo\n", result.output);
}

TEST(ChildProcess, ErrorsCanBeThrownAwayAndInputIsEmptyUnlessGiven)
{
  ChildOptions options;
  options.take_errors = false;
  EXPECT_EQ("0\n", shell("echo noise >&2; wc -c", options).output);

  int ends[2];
  ASSERT_EQ(0, pipe(ends));
  ASSERT_EQ(5, write(ends[1], "hello", 5));
  close(ends[1]);
  options.input = ends[0];
  EXPECT_EQ("hello", shell("cat", options).output);
  close(ends[0]);
}

TEST(ChildProcess, SaysWhichSignalEndedIt)
{
  const ChildResult result = shell("kill -SEGV $$");

  ASSERT_TRUE(WIFSIGNALED(result.status));
  EXPECT_EQ(SIGSEGV, WTERMSIG(result.status));
}

TEST(ChildProcess, OneThatHangsIsKilledAndNotLeftBehind)
{
  ChildOptions options;
  options.timeout_s = 0.1;

  const ChildResult result = shell("exec sleep 600", options);

  EXPECT_FALSE(result.in_time);
  EXPECT_EQ(-1, waitpid(-1, nullptr, WNOHANG));
  EXPECT_EQ(ECHILD, errno);
}

TEST(ChildProcess, KeepsTheFirst4096BytesAndReadsTheRest)
{
  const ChildResult result = shell("head -c 300000 /dev/zero | tr '\\0' x");

  EXPECT_TRUE(result.in_time);
  EXPECT_EQ(std::string(4096, 'x'), result.output);
}

TEST(ChildProcess, GetsNoLibraryToPreload)
{
  ASSERT_EQ(0, setenv("LD_PRELOAD", "", 1));
  EXPECT_EQ("unset\n", shell("echo ${LD_PRELOAD-unset}").output);
  unsetenv("LD_PRELOAD");
}

TEST(ChildProcess, TellsAnInterruptionFromACrash)
{
  EXPECT_TRUE(shell("kill -TERM $$").wasInterrupted());
  EXPECT_FALSE(shell("kill -SEGV $$").wasInterrupted());
  EXPECT_FALSE(shell("exit 2").wasInterrupted());
  ChildResult result;
  for (const int signal : {SIGINT, SIGHUP})  // which the program may ignore, as this one's parent did
  {
    result.status = signal;
    EXPECT_TRUE(result.wasInterrupted()) << signal;
  }
}

TEST(ChildProcess, NamesAProgramThatCannotBeStarted)
{
  try
  {
    runChild("/no/such/program", {}, ChildOptions());
    FAIL() << "no error";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_EQ(0U, std::string(error.what()).find("/no/such/program: cannot be started: ")) << error.what();
  }
}

}  // namespace
}  // namespace pi_node
