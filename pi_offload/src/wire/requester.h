#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace pi_offload
{

// How requests and replies travel. SpRequester and SpReplier talk to each other directly, NatsRequester and NatsReplier
// through servers of NATS. Callbacks other than `reply`, `request` and `status` must not throw. Destructors end all
// callbacks, and must not be called from one. Methods are thread safe.

enum class Transport : uint8_t
{
  DIRECT,  ///< TCP from the vehicle to the node
  NATS,    ///< through the nats-server of the node's site
};
inline const char* toString(Transport transport)
{
  return transport == Transport::NATS ? "nats" : "direct";
}

/// The vehicle's end: a link to one node.
class Requester
{
public:
  struct Callbacks
  {
    std::function<void(uint32_t id, std::vector<uint8_t> body, int64_t received_ns)> reply;
    /// `up`: requests can be sent. Else the connection ended or failed; repeated only with a new reason.
    std::function<void(bool up, const std::string& reason)> link;
    std::function<void(uint32_t id)> unserved;             ///< nobody takes requests of this kind; may be empty
    std::function<void(const std::string& text)> problem;  ///< for the log; may be empty
  };
  Requester() = default;
  virtual ~Requester() = default;
  Requester(const Requester&) = delete;
  Requester& operator=(const Requester&) = delete;

  /// @param id  of the request, below 2^31; the reply carries it.
  /// @return false without a connection or if too much is queued; then nothing is sent.
  virtual bool send(uint32_t id, const std::vector<uint8_t>& body) = 0;
  /// Renews the connection. Data under way is lost.
  virtual void reconnect(const std::string& reason) = 0;
  virtual bool connected() const = 0;
};

/// The node's end: hands out requests, sends replies in any order.
class Replier
{
public:
  /// Receiver of a reply; copies are cheap.
  struct Peer
  {
    uint64_t connection = 0;
    std::vector<uint32_t> route;  ///< SP's stack of request numbers, as received
    std::string address;          ///< of the peer; NATS: subject of the reply
    std::string vehicle{};        ///< whose connection it is; empty: the transport does not know
  };
  struct Callbacks
  {
    std::function<void(const Peer& peer, std::vector<uint8_t> body, int64_t received_ns)> request;
    std::function<void(uint64_t connection, const std::string& reason)> closed;  ///< of a connection that was used
    std::function<std::vector<uint8_t>()> status;          ///< what a NATS site tells all vehicles; may be empty
    std::function<void(const std::string& text)> problem;  ///< for the log; may be empty
  };
  Replier() = default;
  virtual ~Replier() = default;
  Replier(const Replier&) = delete;
  Replier& operator=(const Replier&) = delete;

  virtual uint16_t port() const = 0;  ///< that it listens at; 0: it does not
  /// @return false if the connection is gone, or is closed now because it does not read.
  virtual bool reply(const Peer& peer, const std::vector<uint8_t>& body) = 0;
  virtual void close(uint64_t connection, const std::string& reason) = 0;
  virtual void leave() {}                          ///< Lets others take new requests, if it can.
  virtual bool flush(double timeout_s) = 0;        ///< Waits until all replies are out. @return false after a timeout.
  virtual size_t connections() const = 0;          ///< of vehicles
  virtual bool connected() const { return true; }  ///< requests can come
};

}  // namespace pi_offload
