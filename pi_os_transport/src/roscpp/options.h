#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace pi_os_transport
{

/// Options of π-OS in one node.
struct Options
{
  bool enable = true;                     ///< false: every link stays on TCPROS
  std::vector<std::string> include{"*"};  ///< shell patterns of full names of topics to carry
  std::vector<std::string> exclude;       ///< shell patterns of topics that stay on TCPROS
  uint64_t pool_limit_mb = 512;           ///< most shared memory for this node's outgoing messages [MiB], 1 .. 65536
  uint64_t min_bytes = 0;                 ///< messages with a smaller serialised body use TCPROS [B]
  bool skip_zero_fill = true;             ///< arrays that a received message overwrites are not filled with zeros before
  std::string bridge = "default";         ///< name of the bridge to other devices; empty: none is used
  bool require_bridge = false;            ///< true: links to other devices use the bridge or wait, never TCPROS

  bool carries(const std::string& topic) const;

  /// Looks one option up by its lower-case name.
  using Source = std::function<std::optional<std::string>(const std::string& name)>;

  /// Sets the fields that `source` knows. An invalid value changes nothing and adds one line to `errors`: it starts
  /// with `describe(name)` and names the value and the allowed values.
  void load(const Source& source, const std::function<std::string(const std::string&)>& describe,
            std::vector<std::string>* errors);

  /// load() from PI_OS_ENABLE, PI_OS_INCLUDE, PI_OS_EXCLUDE, PI_OS_POOL_LIMIT_MB, PI_OS_MIN_BYTES,
  /// PI_OS_SKIP_ZERO_FILL, PI_OS_BRIDGE, PI_OS_REQUIRE_BRIDGE.
  void loadEnvironment(std::vector<std::string>* errors);
};

}  // namespace pi_os_transport
