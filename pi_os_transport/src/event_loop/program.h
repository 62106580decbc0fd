#pragma once

#include <signal.h>
#include <sys/signalfd.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Makes a signalfd for SIGINT and SIGTERM, blocks both, and ignores SIGPIPE. Call it before the first thread starts.
/// Empty on failure, with errno set.
inline FileDescriptor endSignals()
{
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  signal(SIGPIPE, SIG_IGN);
  return FileDescriptor(signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK));
}

/// The main() of a program with a command line.
/// @param load  reads the options; an empty optional means that help was asked for, which `usage` gives.
/// @param run   gets the options and does the work.
/// @return status of the process; the text of an exception was written to stderr
template <typename Load, typename Run>
int runProgram(const std::string& name, Load load, const std::string& usage, Run run)
{
  try
  {
    const auto options = load();
    if (!options)
    {
      std::fputs(usage.c_str(), stdout);
      return EXIT_SUCCESS;
    }
    run(*options);
    return EXIT_SUCCESS;
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
    return EXIT_FAILURE;
  }
}

}  // namespace pi_os_transport
