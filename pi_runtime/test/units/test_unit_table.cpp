#include "units/unit_table.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <cstddef>
#include <fstream>
#include <thread>
#include <vector>

#include "units/forked_users.h"
#include "units/unit_arbiter.h"

namespace pi_runtime
{
namespace
{

using namespace std::chrono_literals;

class UnitTableTest : public UnitTest
{
protected:
  size_t files() const
  {
    return static_cast<size_t>(
        std::distance(std::filesystem::directory_iterator(folder_), std::filesystem::directory_iterator()));
  }
  std::string pathOfTable() const { return UnitArbiter(KEY, folder_).path(); }

  std::string errorOfOpening()
  {
    try
    {
      UnitArbiter arbiter(KEY, folder_);
    }
    catch (const std::runtime_error& error)
    {
      return error.what();
    }
    return "no error";
  }
};

TEST_F(UnitTableTest, DifferentKeysAreDifferentUnits)
{
  UnitArbiter first("cpu/0-1", folder_);
  UnitArbiter second("cpu 0-1", folder_);
  EXPECT_NE(first.path(), second.path()) << "names that look the same in a file name";
  EXPECT_TRUE(first.tryAcquire());
  EXPECT_TRUE(second.tryAcquire());
  EXPECT_THROW(UnitArbiter("", folder_), std::invalid_argument);
  EXPECT_TRUE(UnitArbiter(std::string(1000, 'x'), folder_).tryAcquire()) << "longer than a file name may be";
}

TEST_F(UnitTableTest, TheLastUserRemovesTheFile)
{
  {
    UnitArbiter first(KEY, folder_);
    {
      UnitArbiter second(KEY, folder_);
      struct stat status;
      ASSERT_EQ(0, stat(second.path().c_str(), &status));
      EXPECT_EQ(0600U, status.st_mode & 07777U);
    }
    EXPECT_EQ(1U, files());
    EXPECT_TRUE(first.tryAcquire());
  }
  EXPECT_EQ(0U, files());
}

TEST_F(UnitTableTest, UsersThatComeAndGoTogetherAgreeOnOneFile)
{
  std::atomic<int> holders{0};
  std::vector<std::thread> threads;
  for (int thread = 0; thread < 4; ++thread)
  {
    threads.emplace_back(
        [&]
        {
          for (int round = 0; round < 200; ++round)
          {
            UnitArbiter arbiter(KEY, folder_);
            ASSERT_TRUE(arbiter.acquire(NONE, 0, LONG));
            EXPECT_EQ(0, holders.fetch_add(1));
            holders.fetch_sub(1);
          }
        });
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  EXPECT_EQ(0U, files());
}

TEST_F(UnitTableTest, TheFileOfKilledUsersIsUsedAgain)
{
  {
    const auto holder = startUser();
    ASSERT_EQ('h', holder->hear());
    holder->killAndLeaveZombie();
  }
  EXPECT_EQ(1U, files());
  {
    UnitArbiter next(KEY, folder_);
    EXPECT_TRUE(next.tryAcquire());
  }
  EXPECT_EQ(0U, files());
}

TEST_F(UnitTableTest, AForkedChildHasNoPartInTheUnit)
{
  UnitArbiter observer(KEY, folder_);
  Child holder(
      [this](Child& test)
      {
        auto arbiter = std::make_unique<UnitArbiter>(KEY, folder_);
        arbiter->acquire(NONE, 0, LONG);
        if (fork() == 0)
        {
          try
          {
            arbiter->tryAcquire();
          }
          catch (const std::logic_error&)
          {
            arbiter.reset();  // must not release what the parent holds
            test.say('e');
          }
          test.hear();  // outlives the parent
          _exit(0);
        }
        pause();
      });
  ASSERT_EQ('e', holder.hear());
  EXPECT_FALSE(observer.acquire(NONE, 0, 0s)) << "the end of the copy released the unit";
  holder.killAndLeaveZombie();
  EXPECT_TRUE(observer.acquire(NONE, 0, LONG)) << "the forked child hides the death of its parent";
}

TEST_F(UnitTableTest, AllPlacesTakenIsAClearError)
{
  std::vector<std::unique_ptr<UnitArbiter>> users;
  for (uint32_t place = 0; place < UnitTable::PLACES; ++place)
  {
    users.push_back(std::make_unique<UnitArbiter>(KEY, folder_));
  }
  const std::string error = errorOfOpening();
  EXPECT_NE(std::string::npos, error.find(users[0]->path())) << error;
  EXPECT_NE(std::string::npos, error.find("all 64 places are taken, the first by process " + std::to_string(getpid())))
      << error;
  ASSERT_TRUE(users[63]->tryAcquire());
  users[17].reset();
  EXPECT_FALSE(UnitArbiter(KEY, folder_).tryAcquire());
}

TEST_F(UnitTableTest, AFileThatIsNoTableIsAClearError)
{
  const std::string path = pathOfTable();
  std::ofstream(path) << "something else";
  std::string error = errorOfOpening();
  EXPECT_NE(std::string::npos, error.find(path + ": has 14 bytes")) << error;
  EXPECT_NE(std::string::npos, error.find("remove it")) << error;

  std::ofstream(path) << std::string(sizeof(UnitTable), 'x');
  error = errorOfOpening();
  EXPECT_NE(std::string::npos, error.find("is no table of a unit in version 2")) << error;

  {
    UnitTable newer{};
    newer.magic = UnitTable::MAGIC;
    newer.version = UnitTable::VERSION + 1;
    newer.places = UnitTable::PLACES;
    std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(&newer), sizeof newer);
  }
  error = errorOfOpening();
  EXPECT_NE(std::string::npos, error.find("is no table of a unit in version 2")) << error;
  std::filesystem::remove(path);
  EXPECT_EQ("no error", errorOfOpening()) << "the way out of the message does not help";
}

TEST_F(UnitTableTest, AFileOfAnotherKindOrUserIsAClearError)
{
  const std::string path = pathOfTable();
  std::filesystem::create_symlink("/dev/null", path);
  EXPECT_NE(std::string::npos, errorOfOpening().find(path + ": cannot be opened"));
  std::filesystem::remove(path);
  ASSERT_EQ(0, mkfifo(path.c_str(), 0600));
  EXPECT_NE(std::string::npos, errorOfOpening().find(path + ": is no file of this user"));
  std::filesystem::remove(path);
  if (geteuid() == 0)
  {
    std::ofstream(path) << "";
    ASSERT_EQ(0, chown(path.c_str(), 65534, 65534));
    EXPECT_NE(std::string::npos, errorOfOpening().find(path + ": is no file of this user"));
  }
  EXPECT_THROW(UnitArbiter(KEY, folder_ + "/missing"), std::runtime_error);
}

TEST_F(UnitTableTest, AnUnfinishedTableIsMadeAnew)
{
  std::ofstream(pathOfTable()) << "";
  EXPECT_EQ("no error", errorOfOpening());
  std::ofstream(pathOfTable()) << std::string(sizeof(UnitTable), '\0');
  EXPECT_EQ("no error", errorOfOpening());
}

TEST_F(UnitTableTest, MemoryThatRunsOutIsAClearErrorAndLeavesNothing)
{
  const rlimit small{1000, 1000};
  Child limited(
      [&](Child& test)
      {
        std::signal(SIGXFSZ, SIG_IGN);
        setrlimit(RLIMIT_FSIZE, &small);
        const std::string error = errorOfOpening();
        test.say(error.find("cannot get " + std::to_string(sizeof(UnitTable)) + " bytes") != std::string::npos ? 'e'
                                                                                                               : 'n');
      });
  EXPECT_EQ('e', limited.hear());
  EXPECT_EQ(0U, files());
}

TEST(UnitTable, HasTheLayoutOfItsVersion)
{
  static_assert(UnitTable::VERSION == 2, "pin the new layout here");
  EXPECT_EQ(0U, offsetof(UnitTable, magic));
  EXPECT_EQ(8U, offsetof(UnitTable, version));
  EXPECT_EQ(12U, offsetof(UnitTable, places));
  EXPECT_EQ(64U, offsetof(UnitTable, holder));
  EXPECT_EQ(128U, offsetof(UnitTable, place));
  EXPECT_EQ(0U, offsetof(UnitTable::Place, waiting));
  EXPECT_EQ(4U, offsetof(UnitTable::Place, wake));
  EXPECT_EQ(8U, offsetof(UnitTable::Place, pid));
  EXPECT_EQ(12U, offsetof(UnitTable::Place, priority));
  EXPECT_EQ(16U, offsetof(UnitTable::Place, deadline_ns));
  EXPECT_EQ(24U, offsetof(UnitTable::Place, arrival));
  EXPECT_EQ(32U, offsetof(UnitTable::Place, blocking_budget_ns));
  EXPECT_EQ(40U, offsetof(UnitTable::Place, streams_version));
  EXPECT_EQ(44U, offsetof(UnitTable::Place, stream_count));
  EXPECT_EQ(48U, offsetof(UnitTable::Place, streams));
  EXPECT_EQ(40U, offsetof(SharedStream, period_s));
  EXPECT_EQ(72U, offsetof(SharedStream, jobs));
  EXPECT_EQ(88U, offsetof(SharedStream, p50_s));
  EXPECT_EQ(100U, offsetof(SharedStream, priority));
  EXPECT_EQ(104U, offsetof(SharedStream, reserved));
  EXPECT_EQ(112U, sizeof(SharedStream));
  EXPECT_EQ(1856U, sizeof(UnitTable::Place));
  EXPECT_EQ(118912U, sizeof(UnitTable));
}

}  // namespace
}  // namespace pi_runtime
