#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "engine/node.h"
#include "wire/event_thread.h"
#include "wire/nats_connection.h"
#include "wire/requester.h"

namespace pi_offload
{

// Requests go to subject edge.<service>.<network>, which the workers of a site share in a queue group. A site that has
// none passes them on to the others of its cluster. Sites tell their state on edge.status.<site>.

std::string natsSubject(TaskKind kind, const std::string& network);
/// That speech workers know: there is one language.
constexpr char SPEECH_NETWORK[] = "en_us";
constexpr char STATUS_SUBJECT[] = "edge.status.";

/// The vehicle's end: one connection to the nats-server of one site. Replies come to
/// _INBOX.<vehicle>.<connection>.<id>.
class NatsRequester : public Requester
{
public:
  struct Options
  {
    NatsConnection::Options connection;  ///< with one server
    std::string vehicle;                 ///< a token
    std::string network = "accurate";    ///< that pictures are wanted from; a token
  };
  /// @throws std::invalid_argument for options.
  NatsRequester(const Options& options, Callbacks callbacks);

  bool send(uint32_t id, const std::vector<uint8_t>& body) override;
  void reconnect(const std::string& reason) override;
  bool connected() const override;

private:
  void connect();

  const Options options_;
  const Callbacks callbacks_;
  mutable std::mutex mutex_;
  std::string inbox_;
  std::unique_ptr<NatsConnection> connection_;
};

/// The worker's end.
class NatsReplier : public Replier
{
public:
  struct Options
  {
    NatsOptions nats;
    std::string site;                   ///< a token
    std::vector<std::string> subjects;  ///< to serve
    double idle_timeout_s = 60.0;       ///< a vehicle that asks nothing for longer has left
  };
  /// @throws std::invalid_argument for options.
  NatsReplier(const Options& options, Callbacks callbacks);
  ~NatsReplier() override;

  uint16_t port() const override { return 0; }
  bool reply(const Peer& peer, const std::vector<uint8_t>& body) override;
  void close(uint64_t connection, const std::string& reason) override;
  void leave() override { connection_->unsubscribe(); }
  bool flush(double timeout_s) override { return connection_->flush(timeout_s); }
  size_t connections() const override;
  bool connected() const override { return connection_->connected(); }

private:
  struct Known
  {
    uint64_t number = 0;
    int64_t used_ns = 0;
  };
  void onMessage(NatsConnection::Message message);
  void tick(int64_t now_ns);
  void problem(const std::string& text) const;

  const Options options_;
  const Callbacks callbacks_;
  mutable std::mutex mutex_;
  std::map<std::string, Known> known_;  ///< by the subject of their replies, without its last token
  uint64_t last_ = 0;
  int64_t next_tick_ns_ = 0;
  std::unique_ptr<NatsConnection> connection_;
  EventThread ticker_;
};

}  // namespace pi_offload
