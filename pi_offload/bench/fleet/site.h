#pragma once

#include <memory>
#include <string>
#include <vector>

#include "fleet/nats_server.h"
#include "fleet/program.h"
#include "wire/requester.h"

namespace pi_offload_bench
{

struct SiteOptions
{
  pi_offload::Transport transport = pi_offload::Transport::DIRECT;
  std::string host = "127.0.0.1";    ///< where vehicles reach it
  int workers = 1;                   ///< at once
  double service_s = 0.03;           ///< of a task, in place of the detection
  std::vector<std::string> servers;  ///< NATS: of the worker, its own first
};

/// An EdgeServer in a process of its own, whose detection takes its time and finds nothing. Not thread safe.
class Site
{
public:
  /// @throws as Program.
  Site(std::string id, SiteOptions options);

  void kill() { program_.reset(); }
  void revive();
  /// SIGTERM: it drains. @return its exit status.
  int end() { return program_->end(); }
  bool runs() const { return program_ != nullptr; }
  pid_t process() const { return program_->process(); }
  int port() const { return port_; }

private:
  const std::string id_;
  const SiteOptions options_;
  int port_ = 0;
  std::unique_ptr<Program> program_;
};

/// What that process does until SIGTERM. @param config  made by Site. @throws as EdgeServer.
void runSite(const std::string& config);

}  // namespace pi_offload_bench
