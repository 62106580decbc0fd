#pragma once

#include <optional>
#include <string>
#include <vector>

#include "master/rpc_value.h"

namespace pi_os_transport
{

/// The parameters of a ROS graph: a tree of structs, whose leaves are values of any other type. Not thread safe.
///
/// Keys are resolved names; repeated and trailing slashes do not matter.
class ParameterTree
{
public:
  /// Most namespaces in one key. Whoever reads the tree descends once for each.
  static constexpr size_t MAX_DEPTH = 128;

  enum class SetResult
  {
    DONE,
    ROOT_IS_NO_STRUCT,  ///< "/" cannot be set to a single value
    TOO_DEEP,           ///< more than MAX_DEPTH namespaces; the tree is as it was
  };
  /// A namespace that is needed replaces a value of the same name, and a struct all that was below its key.
  SetResult set(const std::string& key, RpcValue value);
  /// nullptr if it is not set. Valid until the tree changes.
  const RpcValue* get(const std::string& key) const;
  /// @return false if it was not set, or is "/", which cannot be removed.
  bool remove(const std::string& key);
  /// The full names of all leaves.
  RpcValue::Array names() const;
  /// Looks for the first part of `key`, from the namespace `from` upwards.
  /// @param from  a global name. @param key  not private. @return the full key below the namespace that has it.
  std::optional<std::string> search(const std::string& from, const std::string& key) const;

private:
  RpcValue root_{RpcValue::Struct()};
};

/// The key of a subscription to a parameter: canonical with a trailing slash, which makes it a prefix of what it
/// covers.
std::string parameterSubscriptionKey(const std::string& key);

/// Who has to be told what about a change.
struct ParameterUpdate
{
  std::string subscription;  ///< key that somebody has subscribed to
  std::string key;           ///< what has changed, with a trailing slash
  const RpcValue* value;     ///< part of the value given to parameterUpdates(), or an empty struct: unset
  bool by_others;            ///< whoever made the change is not told
};

/// @param subscriptions  keys from parameterSubscriptionKey(). @param value  the new value, an empty struct for one
/// that was removed. @return in the order of ROS's own master.
std::vector<ParameterUpdate> parameterUpdates(const std::vector<std::string>& subscriptions, const std::string& key,
                                              const RpcValue& value);

}  // namespace pi_os_transport
