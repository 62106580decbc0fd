#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace pi_os_transport
{

/// A request to the bridge of this device, a packet on its local socket. Those other than LINK are the first and only
/// one there.
struct BridgeRequest
{
  enum Kind : uint16_t
  {
    LINK = 1,    ///< on a ProcessPair: carry a topic from another device
    TUNNEL = 2,  ///< carry a TCP connection; answered by a Packet of type OFFER with a connected socket, or ENDED
    STATUS = 3,  ///< answered by this header and a descriptor of memory with the state as JSON
    PING = 4,    ///< answered by this header
  };
  static constexpr uint32_t MAGIC = 0x514f6970;
  static constexpr uint16_t VERSION = 2;
  static constexpr size_t LONGEST = 4096;  ///< [B]

  Kind kind = STATUS;
  std::string address;  ///< LINK, TUNNEL: numeric IPv4 address of the other device
  // LINK
  std::string socket_token;  ///< of the publisher's process
  std::string link_token;
  std::string topic;
  std::string type;        ///< message type
  std::string publisher;   ///< node name
  std::string subscriber;  ///< node name
  uint32_t link = 0;       ///< its number in the pair of processes
  // TUNNEL
  uint16_t port = 0;  ///< TCP port on the other device
  std::string service;

  std::vector<uint8_t> encode() const;
  /// @return false with `*error` set if the packet is not a request of this version.
  static bool decode(const std::vector<uint8_t>& packet, BridgeRequest* request, std::string* error);

  /// Name of the socket of the calling user's bridge.
  static std::string socketName(const std::string& bridge);
};

}  // namespace pi_os_transport
