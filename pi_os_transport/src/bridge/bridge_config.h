#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "wire/frame_transport.h"

namespace pi_os_transport
{

constexpr uint16_t BRIDGE_PORT = 8814;  ///< where bridges listen unless told otherwise

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
  bool keep_latest = false;    ///< a message that still waits when the next one comes is superseded by it
  std::string compression;     ///< of sensor_msgs/Image on the way: "jpeg", "png" or "" for none
  int quality = 0;             ///< jpeg: 1 .. 100, default 80; png: level 1 .. 9, default 3; 0 without compression
  bool forward = true;         ///< false: these topics stay on TCPROS between devices
};

/// A range of IPv4 addresses.
struct CIDR
{
  uint32_t network = 0;  ///< host byte order, zero below the prefix
  int prefix = 0;        ///< bits that count, 0 .. 32

  bool contains(uint32_t address) const;  ///< host byte order
  std::string toString() const;
};

/// Everything that can be set on a bridge; the defaults are those of config/bridge.yaml.
struct BridgeConfig
{
  std::string name;                                        ///< of this device, for people; default: its host name
  std::vector<Endpoint> listen{{"0.0.0.0", BRIDGE_PORT}};  ///< port 0: any free one
  Endpoint advertise;              ///< where others reach this bridge; empty address: found by the route to each peer;
                                   ///< port 0: that of `listen`
  std::vector<Endpoint> peers;     ///< connected to from the start, numeric
  std::vector<CIDR> allow;         ///< who may connect; empty: everyone
  std::string wire = "sp";         ///< "sp": own sockets; "nanomsg": libnanomsg
  std::string socket = "default";  ///< nodes find the bridge by this name, see PI_OS_BRIDGE
  uint64_t pool_limit_mb = 512;    ///< most shared memory for incoming messages [MiB], 1 .. 65536
  uint32_t max_message_mb = 256;   ///< larger messages stay on TCPROS and are refused from peers [MiB], 1 .. 1024
  std::vector<TopicOptions> topics;  ///< the first one that matches applies

  /// Options of a topic by its full name; the defaults if nothing matches.
  const TopicOptions& topic(const std::string& full_name) const;
  /// Whether a machine may connect. False for anything but a numeric IPv4 address, unless everyone may.
  bool allows(const std::string& address) const;
};

/// What --help prints.
std::string bridgeUsage();

/// Reads the command line and the file named by its --config; the command line wins, its lists replace those of the
/// file. Host and interface names are resolved now. Arguments with ":=" in them are roslaunch's and ignored.
/// @return nothing if --help was asked for.
/// @throws std::runtime_error with one line that names place, key, value and what is allowed.
std::optional<BridgeConfig> loadBridgeConfig(int argc, const char* const* argv);

}  // namespace pi_os_transport
