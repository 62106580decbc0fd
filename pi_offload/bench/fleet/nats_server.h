#pragma once

#include <memory>
#include <string>

#include "fleet/program.h"

namespace pi_offload_bench
{

/// A nats-server on loopback that can be killed and started again at the same port. Not thread safe.
class NatsServer
{
public:
  /// @param config  more of its configuration; no `listen`. @param host  to listen at.
  /// @throws as Program.
  explicit NatsServer(const std::string& config = "max_payload: 8MB", const std::string& host = "127.0.0.1");

  void kill() { program_.reset(); }
  void end() { program_->end(); }  ///< SIGTERM, and waits
  void revive();
  pid_t process() const { return program_->process(); }
  std::string address() const { return "127.0.0.1:" + port_; }
  std::string routes() const { return "nats-route://127.0.0.1:" + route_port_; }  ///< with a cluster in `config`

private:
  const std::string config_;
  const std::string host_;
  std::string port_ = "-1";  ///< any free one
  std::string route_port_;
  std::unique_ptr<Program> program_;
};

}  // namespace pi_offload_bench
