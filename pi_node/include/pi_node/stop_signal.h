#pragma once

#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdint>
#include <initializer_list>
#include <stdexcept>

namespace pi_node
{

/// The first SIGINT, SIGTERM or SIGHUP asks a tool to stop; the second one ends it at once.
class StopSignal
{
public:
  /// @throws std::runtime_error without descriptors.
  static void install()
  {
    event_ = eventfd(0, EFD_CLOEXEC);
    if (event_ < 0)
    {
      throw std::runtime_error("no descriptor for an event: too many files are open");
    }
    struct sigaction action = {};
    action.sa_handler = [](int signal)
    {
      received_ = signal;
      wake();
    };
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    {
      sigaction(signal, &action, nullptr);
    }
  }

  static bool came() { return received_ != 0; }
  /// Returns once a signal came or wake() was called. Call install() before.
  static void wait()
  {
    uint64_t count = 0;
    while (read(event_, &count, sizeof count) < 0 && errno == EINTR)
    {
    }
  }
  /// Ends wait(). Thread safe and async-signal-safe.
  static void wake()
  {
    const int before = errno;
    const uint64_t one = 1;
    [[maybe_unused]] const ssize_t written = write(event_, &one, sizeof one);  // fails only at 2^64 - 1 calls
    errno = before;
  }
  /// Exit status of the tool: 0, or 128 + the signal.
  static int exitStatus() { return received_ == 0 ? 0 : 128 + received_; }

private:
  static inline volatile std::sig_atomic_t received_ = 0;
  static inline int event_ = -1;
};

}  // namespace pi_node
