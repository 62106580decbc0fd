#pragma once

#include <pi_runtime/AdmitStream.h>
#include <pi_runtime/GetEtc.h>
#include <pi_runtime/GetPolicy.h>
#include <pi_runtime/ListCodelets.h>
#include <pi_runtime/ListStreams.h>
#include <pi_runtime/ListUnits.h>
#include <pi_runtime/RetireStream.h>
#include <pi_runtime/SaveTrace.h>
#include <pi_runtime/SetEtc.h>
#include <pi_runtime/SetPolicy.h>
#include <pi_runtime/SetUnitAvailable.h>
#include <pi_runtime/runtime.h>
#include <ros/ros.h>

#include <memory>
#include <vector>

#include "core/codelet_registry.h"

namespace pi_runtime
{

/// The services that show and set what the runtime knows: units, codelets, ETC table, policy, streams, trace.
class RuntimeServices
{
public:
  /// Starts serving. @param private_node  its callback queue serves them. @param codelets  outlives this object.
  RuntimeServices(ros::NodeHandle private_node, std::shared_ptr<Runtime> runtime, const CodeletRegistry* codelets);

private:
  bool listUnits(ListUnits::Request& request, ListUnits::Response& response);
  bool listCodelets(ListCodelets::Request& request, ListCodelets::Response& response);
  bool getEtc(GetEtc::Request& request, GetEtc::Response& response);
  bool setEtc(SetEtc::Request& request, SetEtc::Response& response);
  bool getPolicy(GetPolicy::Request& request, GetPolicy::Response& response);
  bool setPolicy(SetPolicy::Request& request, SetPolicy::Response& response);
  bool admitStream(AdmitStream::Request& request, AdmitStream::Response& response);
  bool retireStream(RetireStream::Request& request, RetireStream::Response& response);
  bool listStreams(ListStreams::Request& request, ListStreams::Response& response);
  bool setUnitAvailable(SetUnitAvailable::Request& request, SetUnitAvailable::Response& response);
  bool saveTrace(SaveTrace::Request& request, SaveTrace::Response& response);

  const std::shared_ptr<Runtime> runtime_;
  const CodeletRegistry* const codelets_;
  std::vector<ros::ServiceServer> services_;
};

}  // namespace pi_runtime
