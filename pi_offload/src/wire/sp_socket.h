#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace pi_offload
{

/// nanomsg's request-reply protocol over TCP (SP, protocol numbers 48 REQ and 49 REP): what is here talks to NN_REQ and
/// NN_REP of libnanomsg too. Own sockets, for the reasons of docs/design/device_bridge.md: hostile bytes must not end
/// the process, and what is queued for a dead link must be thrown away. Link and close callbacks must not throw; if a
/// reply or request callback does, the connection is closed with that text as its reason.

/// The vehicle's end: one connection to one node, that is made again whenever it breaks. Everything happens in a thread
/// of its own; callbacks come from it, one after the other. Methods are thread safe.
class SpRequester
{
public:
  struct Options
  {
    std::string address;                 ///< host:port
    double connect_timeout_s = 1.0;      ///< for name look-up, connection and handshake, each
    double acknowledge_timeout_s = 5.0;  ///< data that the other end's kernel does not acknowledge: the link is dead
    double reconnect_s = 0.2;            ///< first pause; doubled up to the next
    double max_reconnect_s = 2.0;
    size_t max_queued_bytes = 4U << 20U;   ///< not taken by the kernel yet
    size_t max_message_bytes = 1U << 20U;  ///< of a reply
    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  struct Callbacks
  {
    std::function<void(uint32_t id, std::vector<uint8_t> body, int64_t received_ns)> reply;
    /// `up`: requests can be sent. Not `up`: the connection is over, or could not be made; told once, and again when
    /// the reason is another one. reconnect() is one.
    std::function<void(bool up, const std::string& reason)> link;
  };
  /// @throws std::invalid_argument for options.
  SpRequester(const Options& options, Callbacks callbacks);
  ~SpRequester();  ///< Ends the thread; no callback comes any more. Not to be called from a callback.
  SpRequester(const SpRequester&) = delete;
  SpRequester& operator=(const SpRequester&) = delete;

  /// @param id  of the request, below 2^31; the reply carries it.
  /// @return false without a connection, or if too much is queued: nothing of it is sent then.
  bool send(uint32_t id, const std::vector<uint8_t>& body);
  /// Breaks the connection and makes it again: what is on its way does not arrive any more.
  void reconnect(const std::string& reason);
  bool connected() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The node's end: takes connections, gives out requests, sends replies in any order. Everything happens in a thread of
/// its own; callbacks come from it. Methods are thread safe.
class SpReplier
{
public:
  struct Options
  {
    std::string host = "0.0.0.0";
    uint16_t port = 0;  ///< 0: any free one
    size_t max_connections = 256;
    size_t max_message_bytes = 34U << 20U;
    size_t max_queued_bytes = 4U << 20U;  ///< per connection; one that does not read its replies is closed
    double handshake_timeout_s = 2.0;
    double idle_timeout_s = 60.0;              ///< connections without a request are closed
    double acknowledge_timeout_s = 10.0;       ///< data that the other end's kernel does not acknowledge: it is closed
    size_t max_receiving_bytes = 256U << 20U;  ///< of unfinished messages on all connections; who exceeds it is closed
    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  /// Whom a reply goes to; copies are cheap.
  struct Peer
  {
    uint64_t connection = 0;
    std::vector<uint32_t> route;  ///< SP's stack of request numbers, as it came
    std::string address;
  };
  struct Callbacks
  {
    std::function<void(const Peer& peer, std::vector<uint8_t> body, int64_t received_ns)> request;
    std::function<void(uint64_t connection, const std::string& reason)> closed;  ///< it had been greeted
  };
  /// @throws std::runtime_error naming host, port and reason if it cannot listen.
  SpReplier(const Options& options, Callbacks callbacks);
  ~SpReplier();  ///< Ends the thread; no callback comes any more. Not to be called from a callback.
  SpReplier(const SpReplier&) = delete;
  SpReplier& operator=(const SpReplier&) = delete;

  uint16_t port() const;
  /// @return false if the connection is gone, or is closed now as it does not read its replies.
  bool reply(const Peer& peer, const std::vector<uint8_t>& body);
  void close(uint64_t connection, const std::string& reason = "closed here");
  /// Waits until the kernel has taken all replies. @return false if it did not in time.
  bool flush(double timeout_s);
  size_t connections() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
