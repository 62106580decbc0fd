#pragma once

#include <optional>
#include <string>
#include <vector>

#include "master/rpc_value.h"

namespace pi_os_transport
{

/// The parameters of a ROS graph: a tree of structs with values as leaves. Keys are resolved names; repeated and
/// trailing slashes do not matter. Not thread safe.
class ParameterTree
{
public:
  /// Most namespaces in one key. Limits the recursion of readers.
  static constexpr size_t MAX_DEPTH = 128;

  enum class SetResult
  {
    DONE,
    ROOT_IS_NO_STRUCT,  ///< "/" cannot be set to a single value
    TOO_DEEP,           ///< more than MAX_DEPTH namespaces; the tree is as it was
  };
  /// A namespace in the key replaces a value of the same name. A struct replaces everything below its key.
  SetResult set(const std::string& key, RpcValue value);
  /// Null if it is not set. Valid until the tree changes.
  const RpcValue* get(const std::string& key) const;
  /// @return false if it was not set, or is "/", which cannot be removed.
  bool remove(const std::string& key);
  /// The full names of all leaves.
  RpcValue::Array names() const;
  /// Searches the first part of `key`, from the namespace `from` upwards.
  /// @param from  a global name. @param key  not private. @return the full key, in the namespace that has the first
  /// part
  std::optional<std::string> search(const std::string& from, const std::string& key) const;

private:
  RpcValue root_{RpcValue::Struct()};
};

/// The key of a subscription: canonical with a trailing slash, so that it is a prefix of all keys that it covers.
std::string parameterSubscriptionKey(const std::string& key);

/// A notification about a changed parameter.
struct ParameterUpdate
{
  std::string subscription;  ///< key of the subscription
  std::string key;           ///< the changed key, with a trailing slash
  const RpcValue* value;     ///< part of the value given to parameterUpdates(); an empty struct: unset
  bool by_others;            ///< the node that made the change is not notified
};

/// @param subscriptions  keys from parameterSubscriptionKey(). @param value  the new value; an empty struct if it was
/// removed. @return notifications in the order of ROS's own master
std::vector<ParameterUpdate> parameterUpdates(const std::vector<std::string>& subscriptions, const std::string& key,
                                              const RpcValue& value);

}  // namespace pi_os_transport
