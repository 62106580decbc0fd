#pragma once

#include <csignal>
#include <initializer_list>

namespace pi_node
{

/// The first SIGINT, SIGTERM or SIGHUP asks a tool to stop; the second one ends it at once.
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
  /// Exit status of the tool: 0, or 128 + the signal.
  static int exitStatus() { return received_ == 0 ? 0 : 128 + received_; }

private:
  static inline volatile std::sig_atomic_t received_ = 0;
};

}  // namespace pi_node
