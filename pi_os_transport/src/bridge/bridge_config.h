#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "wire/frame_transport.h"

namespace pi_os_transport
{

constexpr uint16_t BRIDGE_PORT = 8814;  ///< default TCP port of bridges

/// How the bridge treats the topics that a pattern matches.
struct TopicOptions
{
  enum class Priority
  {
    HIGH,
    NORMAL,
    LOW,
  };

  std::string match;  ///< shell pattern on the full topic name
  Priority priority = Priority::NORMAL;
  double rate_limit_hz = 0.0;  ///< most messages per second and publisher that leave this device; 0: no limit
  bool keep_latest = false;    ///< a new message replaces one that still waits
  std::string compression;     ///< of sensor_msgs/Image between devices: "jpeg", "png" or "" for none
  int quality = 0;             ///< jpeg: 1 .. 100, default 80; png: level 1 .. 9, default 3; 0 without compression
  bool forward = true;         ///< false: these topics stay on TCPROS between devices
};

/// A range of IPv4 addresses.
struct CIDR
{
  uint32_t network = 0;  ///< host byte order, zero below the prefix
  int prefix = 0;        ///< number of leading bits that are compared, 0 .. 32

  bool contains(uint32_t address) const;  ///< host byte order
  std::string toString() const;
};

/// Options of a bridge. The defaults equal config/bridge.yaml.
struct BridgeConfig
{
  std::string name;                                        ///< of this device, for display; default: its host name
  std::vector<Endpoint> listen{{"0.0.0.0", BRIDGE_PORT}};  ///< port 0: any free one
  Endpoint advertise;              ///< where peers reach this bridge; empty address: found from the route to each peer;
                                   ///< port 0: that of `listen`
  std::vector<Endpoint> peers;     ///< connected to from the start, numeric
  std::vector<CIDR> allow;         ///< who may connect; empty: everyone
  std::string wire = "sp";         ///< "sp": own sockets; "nanomsg": libnanomsg
  std::string socket = "default";  ///< nodes find the bridge by this name, see PI_OS_BRIDGE
  int nice = 0;                    ///< scheduling weight of the bridge, -20 (most) .. 19
  uint64_t pool_limit_mb = 512;    ///< most shared memory for incoming messages [MiB], 1 .. 65536
  uint32_t max_message_mb = 256;   ///< larger messages stay on TCPROS and are refused from peers [MiB], 1 .. 1024
  std::vector<TopicOptions> topics;  ///< the first one that matches applies

  /// Options of a topic, by its full name; the defaults if no pattern matches.
  const TopicOptions& topic(const std::string& full_name) const;
  /// True if a machine may connect. Only numeric IPv4 addresses are compared; without `allow` every machine may.
  bool allows(const std::string& address) const;
};

/// The text of --help.
std::string bridgeUsage();

/// Reads the command line and the file named by --config. The command line overrides the file; its lists replace the
/// file's lists. Resolves host and interface names. Ignores arguments with ":=", which come from roslaunch.
/// @return nothing if --help was asked for.
/// @throws std::runtime_error with one line that names the place, key, value and allowed values.
std::optional<BridgeConfig> loadBridgeConfig(int argc, const char* const* argv);

}  // namespace pi_os_transport
