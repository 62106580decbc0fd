#pragma once

#include <map>
#include <string>

#include "fleet/program.h"

namespace pi_offload_bench
{

/// An edge_server in a process of its own, that ends with this object at the latest. Not thread safe.
class ServerProcess
{
public:
  /// Starts it and waits until it works.
  /// @param program  path of edge_server.
  /// @param config   text of its YAML file, with `health` enabled.
  /// @throws std::runtime_error with what it said if it did not begin to work within 60 s.
  ServerProcess(const std::string& program, const std::string& config);

  const std::string& address() const { return address_; }
  /// What it tells at /metrics, by name with labels. @throws std::runtime_error if it does not answer.
  std::map<std::string, double> metrics() const;
  double processorSeconds() const;  ///< user and system, so far
  /// SIGTERM; waits for its end. @return its exit status; -1: a signal ended it.
  int end() { return program_.end(); }
  void kill() { program_.kill(); }

private:
  Program program_;
  const std::string address_;
  const int health_port_;
};

}  // namespace pi_offload_bench
