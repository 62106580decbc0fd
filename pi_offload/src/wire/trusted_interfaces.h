#pragma once

#include <string>
#include <vector>

#include "wire/socket_tools.h"

namespace pi_offload
{

/// The interfaces that connections without encryption may use: the loopback interface, and those that the user names,
/// because a tunnel is behind them or a network without strangers. Immutable, so thread safe.
class TrustedInterfaces
{
public:
  explicit TrustedInterfaces(std::vector<std::string> names) : names_(std::move(names)) {}

  /// @throws std::invalid_argument naming `field` and a name that no interface can have.
  void validate(const std::string& field) const;
  /// Binds a socket, before it connects, to the trusted interface by which `address` is reached: if that interface
  /// goes, the connection ends with it. @return why it must not connect; empty: it may.
  std::string admitOutgoing(int fd, const SocketAddress& address) const;
  /// Binds an accepted socket to the trusted interface that `peer` came through.
  /// @return why it must be closed; empty: it may stay.
  std::string admitIncoming(int fd, const SocketAddress& peer) const;
  /// Whether a server may listen here; anywhere means: at trusted interfaces, see admitIncoming().
  /// @return why not; empty: it may.
  std::string admitListener(int fd) const;

private:
  bool has(const std::string& name) const;
  std::string refusal(const std::string& what, const std::string& interface) const;

  std::vector<std::string> names_;
};

}  // namespace pi_offload
