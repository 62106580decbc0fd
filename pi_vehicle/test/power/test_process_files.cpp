// Times and memory of processes as /proc says, from made-up folders and of this process itself.

#include "power/process_files.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <future>
#include <thread>

namespace pi_vehicle::power
{
namespace
{

using pi_node::test_support::TemporaryFolder;

/// A line of /proc/PID/stat. @param start  in ticks.
std::string statLine(int pid, const std::string& name, char state, int user, int system, int start)
{
  return std::to_string(pid) + " (" + name + ") " + state + " 1 2 3 4 5 6 7 8 9 10 " + std::to_string(user) + " " +
         std::to_string(system) + " 13 14 15 16 17 18 " + std::to_string(start) + " 20 21\n";
}

class FakeProcesses : public testing::Test
{
protected:
  void add(int pid, const std::string& name, char state, int user, int system, int start)
  {
    std::filesystem::create_directories(root_.path() + "/" + std::to_string(pid) + "/task");
    root_.file(std::to_string(pid) + "/stat", statLine(pid, name, state, user, system, start));
  }
  void addThread(int pid, int tid, const std::string& name, int user)
  {
    const std::string folder = std::to_string(pid) + "/task/" + std::to_string(tid);
    std::filesystem::create_directories(root_.path() + "/" + folder);
    root_.file(folder + "/stat", statLine(tid, name, 'S', user, 0, 7));
  }

  const TemporaryFolder root_;
  const ProcessFiles files_{root_.path(), 100.0};
};

TEST_F(FakeProcesses, TimesAreUserAndSystem)
{
  add(12, "vio_node", 'R', 150, 50, 777);
  const auto process = files_.process(12);
  ASSERT_TRUE(process);
  EXPECT_DOUBLE_EQ(2.0, process->cpu_s);
  EXPECT_EQ(777U, process->start_ticks);
}

TEST_F(FakeProcesses, NamesMayHoldBlanksAndBrackets)
{
  add(12, "a (b) c) R", 'S', 100, 0, 5);
  ASSERT_TRUE(files_.process(12));
  EXPECT_DOUBLE_EQ(1.0, files_.process(12)->cpu_s);
  addThread(12, 13, "odd) S 1 (x", 30);
  ASSERT_EQ(1U, files_.threads(12).size());
  EXPECT_EQ("odd) S 1 (x", files_.threads(12)[0].name);
}

TEST_F(FakeProcesses, WhatIsGoneDamagedOrAZombieIsMissing)
{
  EXPECT_FALSE(files_.process(99));
  EXPECT_TRUE(files_.threads(99).empty());
  EXPECT_FALSE(files_.memory(99));
  EXPECT_FALSE(files_.machine());
  add(12, "x", 'Z', 1, 1, 1);
  EXPECT_FALSE(files_.process(12));
  root_.file("12/stat", "12 (x) S 1 2");
  EXPECT_FALSE(files_.process(12));
  root_.file("12/stat", "");
  EXPECT_FALSE(files_.process(12));
}

TEST_F(FakeProcesses, MemoryIsProportional)
{
  add(12, "x", 'S', 1, 1, 1);
  root_.file("12/smaps_rollup", "55-7f ---p 00000000 00:00 0 [rollup]\nRss: 900 kB\nPss: 500 kB\nPss_Dirty: 100 kB\n");
  EXPECT_DOUBLE_EQ(512000.0, files_.memory(12).value_or(0.0));
}

TEST_F(FakeProcesses, TheComputerIsBusyWhileItIsNeitherIdleNorWaiting)
{
  root_.file("stat",
             "cpu  100 20 80 5000 300 10 30 500 70 0\ncpu0 1 1 1 1 1 1 1 0 0 0\ncpu1 1 1 1 1 1 1 1 0 0 0\nintr 5\n");
  const auto machine = files_.machine();
  ASSERT_TRUE(machine);
  EXPECT_DOUBLE_EQ(2.4, machine->busy_s);
  EXPECT_EQ(2U, machine->cores);
}

TEST(ProcessFiles, FindsTheNamedThreadsOfThisProcess)
{
  std::promise<void> end;
  std::promise<void> named;
  std::thread thread(
      [&]
      {
        pthread_setname_np(pthread_self(), "test_worker");
        named.set_value();
        end.get_future().wait();
      });
  named.get_future().wait();
  const ProcessFiles files;
  const std::vector<ThreadTime> threads = files.threads(::getpid());
  end.set_value();
  thread.join();
  EXPECT_EQ(1, std::count_if(threads.begin(), threads.end(),
                             [](const ThreadTime& one) { return one.name == "test_worker"; }));
  EXPECT_TRUE(files.process(::getpid()));
  EXPECT_GT(files.memory(::getpid()).value_or(0.0), 1e5);
  ASSERT_TRUE(files.machine());
  EXPECT_GE(files.machine()->cores, 1U);
}

}  // namespace
}  // namespace pi_vehicle::power
