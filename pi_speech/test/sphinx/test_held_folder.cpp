#include "sphinx/held_folder.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>

namespace pi_speech
{
namespace
{

namespace fs = std::filesystem;

class HeldFolderTest : public testing::Test
{
protected:
  HeldFolderTest()
  {
    const char* before = std::getenv("TMPDIR");
    before_ = before == nullptr ? "" : before;
    ::setenv("TMPDIR", place_.path().c_str(), 1);
  }
  ~HeldFolderTest() override
  {
    if (before_.empty())
    {
      ::unsetenv("TMPDIR");
    }
    else
    {
      ::setenv("TMPDIR", before_.c_str(), 1);
    }
  }
  ptrdiff_t folders() const { return std::distance(fs::directory_iterator(place_.path()), fs::directory_iterator()); }

  const pi_node::test_support::TemporaryFolder place_;

private:
  std::string before_;
};

TEST_F(HeldFolderTest, GoesWithTheObjectAndAllThatIsInIt)
{
  {
    const HeldFolder folder;
    EXPECT_EQ(place_.path(), fs::path(folder.path()).parent_path());
    ASSERT_TRUE(fs::create_directory(folder.path() + "/inside"));
    EXPECT_EQ(1, folders());
  }
  EXPECT_EQ(0, folders());
}

TEST_F(HeldFolderTest, RemovesWhatAKilledProcessLeftAndNothingElse)
{
  const HeldFolder living;
  fs::create_directory(place_.path() + "/pi_speechless");
  const pid_t child = ::fork();
  if (child == 0)
  {
    const HeldFolder folder;
    ::kill(::getpid(), SIGKILL);
  }
  ASSERT_GT(child, 0);
  int status = 0;
  ASSERT_EQ(child, ::waitpid(child, &status, 0));
  ASSERT_TRUE(WIFSIGNALED(status));
  ASSERT_EQ(3, folders());  // of the living, of the killed one, of somebody else

  const HeldFolder next;
  EXPECT_EQ(3, folders());
  EXPECT_TRUE(fs::exists(living.path()));
  EXPECT_TRUE(fs::exists(next.path()));
  EXPECT_TRUE(fs::exists(place_.path() + "/pi_speechless"));
}

TEST_F(HeldFolderTest, TakesAnotherPlaceWhereTheFirstHasNone)
{
  ::setenv("TMPDIR", (place_.path() + "/missing").c_str(), 1);
  EXPECT_EQ("/dev/shm", fs::path(HeldFolder().path()).parent_path());
}

}  // namespace
}  // namespace pi_speech
