#pragma once

#include <pi_offload/Decide.h>
#include <pi_offload/SetPolicy.h>
#include <std_srvs/SetBool.h>

#include <string>

#include "client/offload_client.h"

namespace pi_offload
{

/// Services about the decisions: ~decide asks for one, ~set_policy and ~enable change how they are made.
/// Runs on the service thread.
class PolicyServices
{
public:
  /// @param options  of the engine as it was started. @param options, client  outlive this object.
  PolicyServices(const EngineOptions* options, OffloadClient* client);

  const std::string& policy() const { return policy_name_; }
  bool decide(Decide::Request& request, Decide::Response& response);
  bool setPolicy(SetPolicy::Request& request, SetPolicy::Response& response);
  bool enable(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response);

private:
  void decideNow(TaskKind kind, const Decide::Request& request, Decide::Response* response, int64_t now_ns);

  const EngineOptions* const options_;
  OffloadClient* const client_;
  std::string policy_name_;
  PolicyOptions policy_;
};

}  // namespace pi_offload
