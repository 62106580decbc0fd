#pragma once

namespace pi_os_transport
{

/// Why a link, or the calls of a service, use TCPROS. `pi_os doctor` explains the names.
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
  switch (reason)
  {
    case Fallback::NONE:
      return "";
    case Fallback::NEGOTIATING:
      return "negotiating";
    case Fallback::DISABLED:
      return "disabled";
    case Fallback::EXCLUDED:
      return "excluded";
    case Fallback::UDP:
      return "udp";
    case Fallback::PEER_SILENT:
      return "peer_silent";
    case Fallback::PEER_VERSION:
      return "peer_version";
    case Fallback::UNREACHABLE:
      return "unreachable";
    case Fallback::OTHER_USER:
      return "other_user";
    case Fallback::NO_MEMORY:
      return "no_memory";
    case Fallback::BROKEN:
      return "broken";
  }
  return "";
}

}  // namespace pi_os_transport
