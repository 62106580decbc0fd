#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "wire/requester.h"

namespace pi_offload
{

// nanomsg's request-reply protocol over TCP (SP, protocol numbers 48 REQ and 49 REP), compatible with NN_REQ and NN_REP
// of libnanomsg; docs/design/offload.md tells why libnanomsg does not stand behind them. Link and close callbacks must
// not throw. If a reply or request callback throws, the connection is closed with that text as the reason.

/// One connection to one node, which is renewed when it breaks. Callbacks come from a thread of this class.
class SpRequester : public Requester
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
  /// @throws std::invalid_argument for options.
  SpRequester(const Options& options, Callbacks callbacks);
  ~SpRequester() override;

  bool send(uint32_t id, const std::vector<uint8_t>& body) override;
  void reconnect(const std::string& reason) override;
  bool connected() const override;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Accepts connections. Callbacks come from a thread of this class.
class SpReplier : public Replier
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
  /// @throws std::runtime_error naming host, port and reason if it cannot or must not listen.
  SpReplier(const Options& options, Callbacks callbacks);
  ~SpReplier() override;

  uint16_t port() const override;
  bool reply(const Peer& peer, const std::vector<uint8_t>& body) override;
  void close(uint64_t connection, const std::string& reason = "closed here") override;
  bool flush(double timeout_s) override;
  size_t connections() const override;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
