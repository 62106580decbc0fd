#include "fleet/nats_server.h"

namespace pi_offload_bench
{

NatsServer::NatsServer(const std::string& config, const std::string& host) : config_(config), host_(host)
{
  revive();
  const std::string& log = program_->beginning();
  port_ = between(log, "Listening for client connections on " + host_ + ":", "\n");
  route_port_ = between(log, "Listening for route connections on 127.0.0.1:", "\n");
}

void NatsServer::revive()
{
  // What it says last.
  const std::string last =
      config_.find("cluster") == std::string::npos ? "Server is ready" : "for route connections on ";
  const auto works = [&last](const std::string& log)
  { return log.find(last) != std::string::npos && log.back() == '\n'; };
  program_ = std::make_unique<Program>("nats-server", "--config",
                                       "listen: \"" + host_ + ":" + port_ + "\"" + "\n" + config_, works);
}

}  // namespace pi_offload_bench
