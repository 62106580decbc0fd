#pragma once

#include <cstdint>
#include <map>
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

/// What a device may exchange with this one, by the name in its certificate or the id of its shared key.
struct TrustOptions
{
  std::string name;                 ///< shell pattern
  bool allow = true;                ///< false: refused, as one whose key was stolen
  std::vector<std::string> topics;  ///< shell patterns of full names of topics and services; empty: all
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
  Endpoint advertise;           ///< where peers reach this bridge; empty address: found from the route to each peer;
                                ///< port 0: that of `listen`
  std::vector<Endpoint> peers;  ///< connected to from the start, numeric
  std::map<Endpoint, std::string> peer_names;  ///< of those that must have a certain name
  std::vector<CIDR> allow;           ///< who may connect; empty: peers, and devices with nodes in the ROS graph
  std::string master;                ///< URI of the ROS master; empty: ROS_MASTER_URI, else roscore on this device
  std::string secure = "off";        ///< "off", or "tls": only protected connections
  std::string keys;                  ///< folder of this device's keys; empty: ~/.config/pi_os/keys
  std::vector<TrustOptions> trust;   ///< the first one that matches applies; empty: all that prove an identity
  std::string wire = "sp";           ///< "sp": own sockets; "nanomsg": libnanomsg
  std::string socket = "default";    ///< nodes find the bridge by this name, see PI_OS_BRIDGE
  int nice = 0;                      ///< scheduling weight of the bridge, -20 (most) .. 19
  uint64_t pool_limit_mb = 512;      ///< most shared memory for incoming messages [MiB], 1 .. 65536
  uint32_t max_message_mb = 256;     ///< larger messages stay on TCPROS and are refused from peers [MiB], 1 .. 1024
  std::vector<TopicOptions> topics;  ///< the first one that matches applies

  /// Options of a topic, by its full name; the defaults if no pattern matches.
  const TopicOptions& topic(const std::string& full_name) const;
  bool isSecure() const { return secure != "off"; }
  /// Null if no entry of `trust` matches.
  const TrustOptions* trustOf(const std::string& identity) const;
  /// True if a topic or service may be exchanged with a device that may connect.
  bool trusts(const std::string& identity, const std::string& full_name) const;
  /// False if `allow` keeps a machine out. Only numeric IPv4 addresses are compared. Without `allow`, RosGraph decides.
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
