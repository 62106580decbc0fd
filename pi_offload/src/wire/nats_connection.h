#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace pi_offload
{

/// Which servers of NATS, and who this is to them.
struct NatsOptions
{
  std::vector<std::string> servers;  ///< host:port each; the first that answers is used
  std::string ca_file;               ///< PEM, absolute path; empty, like the next two: no TLS, on loopback only
  std::string certificate_file;      ///< PEM, shows who this is
  std::string key_file;              ///< PEM, of the certificate

  bool tls() const { return !ca_file.empty(); }
  /// @throws std::invalid_argument naming field, value and bound: addresses, files that cannot be read, a certificate
  ///   that has expired, a host other than this one without TLS.
  void validate() const;
  /// @throws std::invalid_argument naming the field if the server cannot be used, as validate().
  void requireServer(const std::string& field, const std::string& server) const;
};

bool isLoopback(const std::string& host);
/// A token of a subject: no spaces, '.', '*' or '>'. @throws std::invalid_argument naming field and value.
void requireNatsToken(const std::string& field, const std::string& value);

/// A connection to one of some servers, which is renewed when it breaks. All connections of a process share one thread
/// for their input and output, and one that opens and closes them. Methods are thread safe.
class NatsConnection
{
public:
  struct Options
  {
    NatsOptions nats;
    std::string name;  ///< in the server's log
    double connect_timeout_s = 1.0;
    double reconnect_s = 0.2;  ///< first pause; doubles up to max_reconnect_s
    double max_reconnect_s = 2.0;
    size_t max_queued_bytes = 8U << 20U;  ///< not taken by the kernel yet
    bool only_these = false;              ///< do not use other servers of the cluster
  };
  struct Subscription
  {
    std::string subject;
    std::string group{};  ///< queue group, of which one member gets each message; empty: none
  };
  struct Message
  {
    std::string subject;
    std::string reply;  ///< subject for an answer; may be empty
    std::vector<uint8_t> body;
    bool unserved = false;  ///< in place of an answer: nobody has subscribed to the request's subject
  };
  /// Must not destroy the connection; `link` and `problem` must not throw.
  struct Callbacks
  {
    std::function<void(Message message)> message;
    std::function<void(bool up, const std::string& reason)> link;  ///< repeated only with a new reason
    std::function<void(const std::string& text)> problem;          ///< for the log: what the server refuses
  };
  /// Begins to connect. @throws std::invalid_argument for options.
  NatsConnection(const Options& options, std::vector<Subscription> subscriptions, Callbacks callbacks);
  ~NatsConnection();  ///< Ends all callbacks.
  NatsConnection(const NatsConnection&) = delete;
  NatsConnection& operator=(const NatsConnection&) = delete;

  bool connected() const;
  /// @return false if it is not connected, too much is queued, or the body is larger than the server's max_payload,
  ///   which is reported once.
  bool publish(const std::string& subject, const std::string& reply, const std::vector<uint8_t>& body);
  void unsubscribe();            ///< No new messages come; those on their way do.
  bool flush(double timeout_s);  ///< Waits until the server has all. @return false after a timeout.
  static std::string uniqueToken();

private:
  struct State;
  class Loop;
  const std::shared_ptr<Loop> loop_;
  const std::shared_ptr<State> state_;
};

}  // namespace pi_offload
