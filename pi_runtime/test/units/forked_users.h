#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <new>
#include <string>
#include <thread>

#include "units/unit_arbiter.h"

namespace pi_runtime
{

inline constexpr int64_t NONE = UnitArbiter::NO_DEADLINE;
inline constexpr auto LONG = std::chrono::seconds(30);  // never reached in a test that passes
inline constexpr const char* KEY = "gpu 0";

/// A process that runs `body` and talks with the test by single characters. Killed at the end if it still runs.
class Child
{
public:
  explicit Child(const std::function<void(Child&)>& body)
  {
    int ends[2];
    EXPECT_EQ(0, socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends));
    pid_ = fork();
    if (pid_ == 0)
    {
      channel_ = ends[1];
      close(ends[0]);
      try
      {
        body(*this);
      }
      catch (const std::exception& error)
      {
        dprintf(STDERR_FILENO, "child: %s\n", error.what());
        _exit(1);
      }
      _exit(0);
    }
    channel_ = ends[0];
    close(ends[1]);
  }
  ~Child()
  {
    if (!reaped_)
    {
      signal(SIGKILL);
      reap();
    }
    close(channel_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  void say(char word) { EXPECT_EQ(1, ::send(channel_, &word, 1, MSG_NOSIGNAL)); }
  /// The next word of the other side; 0 if it ended or says nothing for a long time.
  char hear()
  {
    pollfd readable{channel_, POLLIN, 0};
    char word = 0;
    return poll(&readable, 1, static_cast<int>(std::chrono::milliseconds(LONG).count())) == 1 &&
                   read(channel_, &word, 1) == 1
               ? word
               : '\0';
  }
  pid_t pid() const { return pid_; }
  void signal(int number) { ::kill(pid_, number); }
  /// Exit status, or -1 if it was killed.
  int reap()
  {
    int status = 0;
    EXPECT_EQ(pid_, waitpid(pid_, &status, 0));
    reaped_ = true;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  /// Returns once the process is dead, leaving it unreaped: its process id and /proc entry stay.
  void killAndLeaveZombie()
  {
    signal(SIGKILL);
    siginfo_t info;
    EXPECT_EQ(0, waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOWAIT));
  }

private:
  pid_t pid_ = -1;
  int channel_ = -1;
  bool reaped_ = false;
};

/// Memory that forked children share with the test.
template <typename T>
class Shared
{
public:
  Shared() : value_(new (mmap(nullptr, sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0)) T()) {}
  ~Shared() { munmap(value_, sizeof(T)); }
  Shared(const Shared&) = delete;
  Shared& operator=(const Shared&) = delete;
  T* operator->() const { return value_; }

private:
  T* value_;
};

/// A folder for the tables of one test.
class UnitTest : public testing::Test
{
protected:
  UnitTest()
  {
    char name[] = "/tmp/test_unit_arbiter.XXXXXX";
    folder_ = mkdtemp(name);
  }
  ~UnitTest() override { std::filesystem::remove_all(folder_); }

  /// Where there is no event to wait for: the other process says that it waits only by its entry in the table.
  static bool becomesTrue(const std::function<bool()>& condition)
  {
    const auto until = std::chrono::steady_clock::now() + LONG;
    while (!condition())
    {
      if (std::chrono::steady_clock::now() > until)
      {
        return false;
      }
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    return true;
  }

  /// Starts a process that says 'h' when it holds the unit, hears one word, releases, and says 'r'.
  std::unique_ptr<Child> startUser(int64_t deadline_ns = NONE, int priority = 0)
  {
    return std::make_unique<Child>(
        [this, deadline_ns, priority](Child& test)
        {
          UnitArbiter arbiter(KEY, folder_);
          test.say(arbiter.acquire(deadline_ns, priority, LONG) ? 'h' : 'f');
          test.hear();
          arbiter.release();
          test.say('r');
        });
  }

  std::string folder_;
};

}  // namespace pi_runtime
