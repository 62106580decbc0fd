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

/// Who publishes, subscribes and serves what, and where each node is reached. Keys are names of topics, services and
/// parameters. Not thread safe.
class Registrations
{
public:
  struct Provider
  {
    std::string node;
    std::string api;  ///< URI of the node's slave API
    bool operator==(const Provider& other) const { return node == other.node && api == other.api; }
  };
  /// A node of this name was registered with another API: a new process has taken over, all of the old one is removed.
  struct Replaced
  {
    std::string api;
    int pid = 0;                      ///< of the old process; 0: unknown
    std::vector<std::string> topics;  ///< that it published
  };
  struct Removal
  {
    std::string message;  ///< in the words of ROS's own master
    int count = 0;        ///< 1 if it was registered, else 0
  };

  /// Registers a node once, however often it is called; a service goes to who registers it last.
  /// @param service_api  URI of the service; empty for other roles.
  std::optional<Replaced> add(Role role, const std::string& key, const std::string& node, const std::string& api,
                              const std::string& service_api = "");
  /// Takes one registration away, and forgets a node that has none left.
  /// @param api  has to be the one registered: of the service for services, else of the node.
  Removal remove(Role role, const std::string& key, const std::string& node, const std::string& api);

  /// In the order of their registration.
  const std::vector<Provider>& providers(Role role, const std::string& key) const;
  /// A list of URIs, as the Master API hands it out.
  RpcValue::Array apis(Role role, const std::string& key) const;
  /// nullptr if the node has no registration.
  const std::string* nodeApi(const std::string& node) const;
  /// Notes which process the node is; nothing if it is not registered with this API.
  void setPid(const std::string& node, const std::string& api, int pid);
  /// True if a node is registered with this API.
  bool isInUse(const std::string& api) const;
  /// nullptr if nobody provides the service.
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
