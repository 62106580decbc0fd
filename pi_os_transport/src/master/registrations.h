#pragma once

#include <array>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "master/rpc_value.h"

namespace pi_os_transport
{

enum class Role
{
  SUBSCRIBER,
  PUBLISHER,
  SERVICE,
  PARAMETER_SUBSCRIBER,
};

/// The registered publishers, subscribers and services, and the addresses of nodes. Keys are names of topics, services
/// and parameters. Not thread safe.
class Registrations
{
public:
  struct Provider
  {
    std::string node;
    std::string api;  ///< URI of the node's slave API
    bool operator==(const Provider& other) const { return node == other.node && api == other.api; }
  };
  /// The old registration of a node that now has another API: a new process has replaced it.
  struct Replaced
  {
    std::string api;
    int pid = 0;                      ///< of the old process; 0: unknown
    std::vector<std::string> topics;  ///< published by the old process
  };
  struct Removal
  {
    std::string message;  ///< same text as ROS's own master
    int count = 0;        ///< 1 if it was registered, else 0
  };

  /// Registers a node; repetitions change nothing. A service belongs to the node that registered it last.
  /// @param service_api  URI of the service; empty for other roles.
  std::optional<Replaced> add(Role role, const std::string& key, const std::string& node, const std::string& api,
                              const std::string& service_api = "");
  /// Removes a registration, and a node without registrations.
  /// @param api  must equal the registered one: of the service for services, else of the node
  Removal remove(Role role, const std::string& key, const std::string& node, const std::string& api);

  /// In the order of registration.
  const std::vector<Provider>& providers(Role role, const std::string& key) const;
  /// A list of URIs, as the Master API returns it.
  RpcValue::Array apis(Role role, const std::string& key) const;
  /// Null if the node has no registration.
  const std::string* nodeApi(const std::string& node) const;
  /// Stores the process id of a node if it is registered with this API.
  void setPid(const std::string& node, const std::string& api, int pid);
  /// True if a node is registered with this API.
  bool isInUse(const std::string& api) const;
  /// Null if no node provides the service.
  const std::string* serviceApi(const std::string& service) const;
  std::vector<std::string> keys(Role role) const;
  /// [[key, [node, ...]], ...]
  RpcValue::Array state(Role role) const;

private:
  static constexpr size_t ROLES = 4;
  using Table = std::map<std::string, std::vector<Provider>>;
  struct Node
  {
    std::string api;
    int pid = 0;  ///< 0: unknown
    std::array<std::set<std::string>, ROLES> keys;
    bool isEmpty() const;
  };
  Replaced removeNode(const std::string& node);

  std::array<Table, ROLES> tables_;
  std::map<std::string, Node> nodes_;
  std::map<std::string, Provider> service_apis_;  ///< the api is that of the service
  bool had_service_ = false;
};

}  // namespace pi_os_transport
