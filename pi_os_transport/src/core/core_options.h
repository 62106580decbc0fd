#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace pi_os_transport
{

/// The command line of pi_core and pi_master: as of roscore and rosmaster, plus --announce.
struct CoreOptions
{
  uint16_t port = 11311;  ///< 0: any free port
  int announce = -1;      ///< descriptor to write the URI to; -1: none
  bool is_verbose = false;
  std::optional<std::chrono::milliseconds> timeout;  ///< of calls to nodes
  std::string host;                                  ///< from __hostname:= or __ip:=

  /// @return nothing if --help was given.
  /// @throws std::invalid_argument naming the argument, its value and the allowed values
  static std::optional<CoreOptions> parse(int argc, char** argv);
  static std::string usage(const std::string& program);
};

}  // namespace pi_os_transport
