#pragma once

#include <csignal>
#include <initializer_list>

namespace pi_node
{

/// The first of SIGINT, SIGTERM and SIGHUP asks a tool to stop in order, the second one ends it at once.
class StopSignal
{
public:
  static void install()
  {
    struct sigaction action = {};
    action.sa_handler = [](int signal) { received_ = signal; };
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP})
    {
      sigaction(signal, &action, nullptr);
    }
  }

  static bool came() { return received_ != 0; }
  /// What the tool ends with: 0, or 128 + the signal.
  static int exitStatus() { return received_ == 0 ? 0 : 128 + received_; }

private:
  static inline volatile std::sig_atomic_t received_ = 0;
};

}  // namespace pi_node
