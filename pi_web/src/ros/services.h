#pragma once

#include "graph/graph_reader.h"

#include <nlohmann/json.hpp>
#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace pi_web
{

/// The services that clients may call. Each has a thread, so that a slow one keeps no other waiting: not "stop". One
/// thread calls all methods.
class Services
{
public:
  explicit Services(pi_node::WarningBoard* warnings) : warnings_(warnings) {}

  struct Service
  {
    std::string name;
    std::string type;
    std::unique_ptr<pi_node::CallbackThread> thread;
  };
  /// @param types  by service, of those that may be called and are there.
  /// @return what to tell clients, in this order.
  std::vector<nlohmann::json> update(const std::map<std::string, std::string>& types);
  /// All of them, as an advertisement.
  nlohmann::json advertisement() const;
  /// @throws std::invalid_argument if there is none.
  const Service& at(uint32_t id) const;
  void stop() { services_.clear(); }

private:
  nlohmann::json describe(const std::vector<uint32_t>& ids) const;

  pi_node::WarningBoard* const warnings_;
  std::map<uint32_t, Service> services_;
  uint32_t last_id_ = 0;
};

}  // namespace pi_web
