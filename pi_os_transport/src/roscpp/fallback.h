#pragma once

#include <cstddef>

namespace pi_os_transport
{

/// Why a link, or the calls of a service, use TCPROS. `pi_os doctor` explains the names, see nameOf().
enum class Fallback
{
  NONE,
  NEGOTIATING,   ///< the peer was asked or answered, but has not connected yet
  DISABLED,      ///< PI_OS_ENABLE=0 in this process
  EXCLUDED,      ///< by PI_OS_INCLUDE or PI_OS_EXCLUDE in this process
  UDP,           ///< the subscriber requests UDPROS
  PEER_SILENT,   ///< the peer's header has no offer or request: no library, or switched off for this name
  PEER_VERSION,  ///< the peer's library has another protocol version
  UNREACHABLE,   ///< the peer's socket is not in this network namespace: container or device
  OTHER_USER,    ///< the peer runs under another user
  NO_MEMORY,     ///< no memory or descriptors for the link itself
  BROKEN,        ///< the peer wrote invalid data, or closed its end
};

/// The name in a process's state.
constexpr const char* nameOf(Fallback reason)
{
  constexpr const char* NAMES[] = {"",           "negotiating", "disabled",     "excluded",
                                   "udp",        "peer_silent", "peer_version", "unreachable",
                                   "other_user", "no_memory",   "broken"};
  return NAMES[static_cast<size_t>(reason)];
}

}  // namespace pi_os_transport
