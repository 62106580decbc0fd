#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "master/node_calls.h"
#include "master/parameter_tree.h"
#include "master/registrations.h"
#include "master/rpc_methods.h"
#include "master/rpc_value.h"

namespace pi_os_transport
{

/// The Master API and the Parameter Server API of ROS 1, with the same status codes and messages as ROS's own master.
/// Notifies subscribers of changes through their slave APIs. Not thread safe.
class MasterApi
{
public:
  /// @param uri  of this master. @param calls  must outlive this object. @param shut_down  called by shutdown() with
  /// its reason. @param log  gets every change; may be empty.
  MasterApi(std::string uri, NodeCalls* calls, std::function<void(const std::string& reason)> shut_down,
            Log log = Log());
  MasterApi(const MasterApi&) = delete;
  MasterApi& operator=(const MasterApi&) = delete;

  /// @param request  XML of a call. @return XML of the answer, in all cases
  std::string answer(std::string_view request) const { return methods_.answer(request); }

  /// Also called by the process of this master.
  void setParameter(const std::string& key, RpcValue value, const std::string& caller);
  /// Null if it is not set. Valid until the next call.
  const RpcValue* parameter(const std::string& key) const { return parameters_.get(key); }
  RpcValue::Array addSubscriber(const std::string& node, const std::string& topic, const std::string& type,
                                const std::string& api);
  RpcValue::Array addPublisher(const std::string& node, const std::string& topic, const std::string& type,
                               const std::string& api);

private:
  void addNodeMethods(std::function<void(const std::string& reason)> shut_down);
  void addParameterMethods();
  void addParameterSubscriptionMethods();
  void addRegistrationMethods();
  void addStateMethods();

  void enrol(Role role, const std::string& key, const std::string& node, const std::string& api,
             const std::string& service_api = "");
  void shutDown(const std::string& node, const Registrations::Replaced& old);
  void logChange(const char* sign, Role role, const std::string& key, const std::string& node,
                 const std::string& api) const;
  void tellSubscribers(const std::string& topic);
  void tellOfParameter(const std::string& key, const RpcValue& value, const std::string* changed_by);

  std::string uri_;
  NodeCalls* calls_;
  Log log_;
  Registrations registrations_;
  ParameterTree parameters_;
  std::map<std::string, std::string> topic_types_;
  RpcMethods methods_;
};

}  // namespace pi_os_transport
