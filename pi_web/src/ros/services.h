#pragma once

#include "graph/graph_reader.h"

#include <pi_node/ros/callback_thread.h>
#include <pi_node/ros/warning_board.h>
#include <nlohmann/json.hpp>

#include <map>
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
    pi_node::CallbackThread* thread = nullptr;
  };
  /// @param types  by service, of those that may be called and are there.
  /// @return what to tell clients, in this order.
  std::vector<nlohmann::json> update(const std::map<std::string, std::string>& types);
  /// All of them, as an advertisement.
  nlohmann::json advertisement() const;
  /// @throws std::invalid_argument if there is none.
  const Service& at(uint32_t id) const;
  /// Returns when the calls under way have ended.
  void stop() { threads_.clear(); }

private:
  nlohmann::json describe(const std::vector<uint32_t>& ids) const;

  pi_node::WarningBoard* const warnings_;
  std::map<uint32_t, Service> services_;
  std::map<std::string, pi_node::CallbackThread>
      threads_;  ///< by service; kept while it is gone: a call may be under way
  uint32_t last_id_ = 0;
};

}  // namespace pi_web
