#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace pi_offload
{

/// Answers probes of an orchestrator and Prometheus by HTTP: GET or HEAD of /healthz (200 while live, else 503),
/// /readyz (200 while ready, else 503) and /metrics. One request per connection, each in a short time; what is more
/// than that is closed. A thread of its own calls the callbacks.
class HealthEndpoint
{
public:
  struct Options
  {
    std::string host = "0.0.0.0";
    uint16_t port = 0;            ///< 0: any free one
    size_t max_connections = 32;  ///< further ones are closed at once
    double timeout_s = 5.0;       ///< for a whole connection
    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  /// What they throw becomes an answer 500 with that text.
  struct Callbacks
  {
    std::function<bool()> live;
    std::function<bool()> ready;
    std::function<std::string()> metrics;  ///< text format of Prometheus
  };
  /// @throws std::invalid_argument for options or a missing callback, std::runtime_error naming host, port and reason.
  HealthEndpoint(const Options& options, Callbacks callbacks);
  ~HealthEndpoint();
  HealthEndpoint(const HealthEndpoint&) = delete;
  HealthEndpoint& operator=(const HealthEndpoint&) = delete;

  uint16_t port() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
