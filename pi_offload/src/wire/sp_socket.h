#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace pi_offload
{

// nanomsg's request-reply protocol over TCP (SP, protocol numbers 48 REQ and 49 REP), compatible with NN_REQ and NN_REP
// of libnanomsg; docs/design/offload.md tells why libnanomsg does not stand behind them. Link and close callbacks must
// not throw. If a reply or request callback throws, the connection is closed with that text as the reason.

/// The vehicle's end: one connection to one node, which is renewed when it breaks. Callbacks come from a thread of this
/// class. Methods are thread safe.
class SpRequester
{
public:
  struct Options
  {
    std::string address;                 ///< host:port
    double connect_timeout_s = 1.0;      ///< for each of name look-up, connection and handshake
    double acknowledge_timeout_s = 5.0;  ///< data without an acknowledgement for longer: the link is dead
    double reconnect_s = 0.2;            ///< first pause; doubles up to max_reconnect_s
    double max_reconnect_s = 2.0;
    size_t max_queued_bytes = 4U << 20U;          ///< not taken by the kernel yet
    size_t max_message_bytes = 1U << 20U;         ///< of a reply
    std::vector<std::string> trusted_interfaces;  ///< that it may use beside the loopback interface; validated apart
    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  struct Callbacks
  {
    std::function<void(uint32_t id, std::vector<uint8_t> body, int64_t received_ns)> reply;
    /// `up`: requests can be sent. Else the connection ended or failed; repeated only with a new reason.
    std::function<void(bool up, const std::string& reason)> link;
  };
  /// @throws std::invalid_argument for options.
  SpRequester(const Options& options, Callbacks callbacks);
  ~SpRequester();  ///< Ends the thread and all callbacks. Not from a callback.
  SpRequester(const SpRequester&) = delete;
  SpRequester& operator=(const SpRequester&) = delete;

  /// @param id  of the request, below 2^31; the reply carries it.
  /// @return false without a connection or if too much is queued; then nothing is sent.
  bool send(uint32_t id, const std::vector<uint8_t>& body);
  /// Renews the connection. Data under way is lost.
  void reconnect(const std::string& reason);
  bool connected() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The node's end: accepts connections, hands out requests, sends replies in any order. Callbacks come from a thread of
/// this class. Methods are thread safe.
class SpReplier
{
public:
  struct Options
  {
    std::string host = "0.0.0.0";
    uint16_t port = 0;  ///< 0: any free one
    size_t max_connections = 256;
    size_t max_message_bytes = 34U << 20U;
    size_t max_queued_bytes = 4U << 20U;  ///< per connection; a peer that does not read is closed
    double handshake_timeout_s = 2.0;
    double idle_timeout_s = 60.0;         ///< connections without a request are closed
    double acknowledge_timeout_s = 10.0;  ///< data without an acknowledgement for longer: it is closed
    size_t max_receiving_bytes =
        256U << 20U;  ///< of unfinished messages on all connections; the connection that exceeds it is closed
    std::vector<std::string> trusted_interfaces;  ///< that it may use beside the loopback interface; validated apart
    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  /// Receiver of a reply; copies are cheap.
  struct Peer
  {
    uint64_t connection = 0;
    std::vector<uint32_t> route;  ///< SP's stack of request numbers, as received
    std::string address;
  };
  struct Callbacks
  {
    std::function<void(const Peer& peer, std::vector<uint8_t> body, int64_t received_ns)> request;
    std::function<void(uint64_t connection, const std::string& reason)>
        closed;                                              ///< of a connection that had sent its header
    std::function<void(const std::string& reason)> refused;  ///< a peer that did not come through a trusted interface
  };
  /// @throws std::runtime_error naming host, port and reason if it cannot or must not listen.
  SpReplier(const Options& options, Callbacks callbacks);
  ~SpReplier();  ///< Ends the thread and all callbacks. Not from a callback.
  SpReplier(const SpReplier&) = delete;
  SpReplier& operator=(const SpReplier&) = delete;

  uint16_t port() const;
  /// @return false if the connection is gone, or is closed now because it does not read.
  bool reply(const Peer& peer, const std::vector<uint8_t>& body);
  void close(uint64_t connection, const std::string& reason = "closed here");
  /// Waits until the kernel has all replies. @return false after a timeout.
  bool flush(double timeout_s);
  size_t connections() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
