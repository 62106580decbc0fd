#pragma once

namespace pi_os_transport
{

/// Why a link, or the calls of a service, are on TCPROS. `pi_os doctor` explains the names.
enum class Fallback
{
  NONE,
  NEGOTIATING,   ///< the peer has been asked or answered, and has not come yet
  DISABLED,      ///< PI_OS_ENABLE=0 in this process
  EXCLUDED,      ///< by PI_OS_INCLUDE or PI_OS_EXCLUDE in this process
  UDP,           ///< the subscriber asks for UDPROS
  PEER_SILENT,   ///< the peer's header offers or asks for nothing: no library there, or switched off for this name
  PEER_VERSION,  ///< the peer's library speaks another version
  UNREACHABLE,   ///< the peer's socket is not in this network namespace: container or device
  OTHER_USER,    ///< the peer runs under another user
  NO_MEMORY,     ///< no memory or descriptors for the link itself
  BROKEN,        ///< the peer wrote nonsense, or closed its end
};

/// Its name in a process's state, in lower case.
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
