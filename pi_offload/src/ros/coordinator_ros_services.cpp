#include "ros/coordinator_ros.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <ros/console.h>

#include <exception>
#include <stdexcept>

#include "ros/conversions.h"

namespace pi_offload
{
namespace
{

using pi_node::format;

constexpr double LONGEST_DEADLINE_S = 3600.0;

}  // namespace

bool CoordinatorRos::statistics(Statistics::Request&, Statistics::Response& response)
{
  const CoordinatorFigures figures = client_.call([this](int64_t now_ns) { return this->figures(now_ns); });
  response.enabled = static_cast<uint8_t>(figures.enabled);
  response.policy = policy_name_;
  response.eta = figures.eta;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    response.kinds.push_back(
        toMsg(static_cast<TaskKind>(kind), figures.statistics.of_kind[kind], figures.p50_s[kind], figures.p99_s[kind]));
  }
  return true;
}

bool CoordinatorRos::decide(Decide::Request& request, Decide::Response& response)
{
  try
  {
    const TaskKind kind = parseTaskKind(request.kind);
    if (!(request.deadline >= 0.0 && request.deadline <= LONGEST_DEADLINE_S))
    {
      throw std::invalid_argument(format("deadline = %g", request.deadline) + ", must be in [0, 3600]");
    }
    if (!(request.input_bytes >= 0.0 && request.input_bytes <= static_cast<double>(MAX_PAYLOAD)))
    {
      throw std::invalid_argument(format("input_bytes = %g", request.input_bytes) +
                                  format(", must be in [0, %.0f]", static_cast<double>(MAX_PAYLOAD)));
    }
    client_.call([&](int64_t now_ns) { decideNow(kind, request, &response, now_ns); });
    response.success = 1;
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

/// On the engine thread.
void CoordinatorRos::decideNow(TaskKind kind, const Decide::Request& request, Decide::Response* response,
                               int64_t now_ns)
{
  const size_t last = client_.lastInputBytes(kind);
  const double usual = 1e6 / 8.0 * options_.client.engine.needs[static_cast<size_t>(kind)].input_mbit;
  const auto bytes = request.input_bytes > 0.0 ? static_cast<size_t>(request.input_bytes)
                     : last > 0                ? last
                                               : static_cast<size_t>(usual);
  const int64_t begin_ns = pi_node::monotonicNs();
  const Decision decision = client_.engine().decide(kind, bytes, request.deadline, now_ns);
  response->decision_time = pi_node::secondsBetween(begin_ns, pi_node::monotonicNs());
  if (decision.node >= 0)
  {
    response->node = client_.engine().nodes(now_ns).at(static_cast<size_t>(decision.node)).description.id;
  }
  response->expected_time = decision.expected_s;
  response->expected_energy = decision.expected_j;
  response->expected_misses = decision.expected_misses;
  response->timeout = decision.timeout_s;
  response->reason = decision.reason;
}

bool CoordinatorRos::setPolicy(SetPolicy::Request& request, SetPolicy::Response& response)
{
  try
  {
    PolicyOptions policy = policy_;
    if (request.miss_cost != 0.0)
    {
      policy.miss_cost_j = request.miss_cost;
      policy.validate();
    }
    const std::string name = request.policy.empty() ? policy_name_ : request.policy;
    client_.call(
        [&](int64_t)
        {
          client_.engine().setPolicy(name);
          client_.engine().setPolicyOptions(policy);
        });
    policy_ = policy;
    policy_name_ = name;
    response.success = 1;
    response.message = "policy " + name + format(", %g J per missed deadline", policy.miss_cost_j);
    ROS_INFO_STREAM_NAMED("coordinator", response.message);
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  response.policy = policy_name_;
  response.miss_cost = policy_.miss_cost_j;
  response.policies = policyNames();
  return true;
}

bool CoordinatorRos::enable(std_srvs::SetBool::Request& request, std_srvs::SetBool::Response& response)
{
  const bool enabled = request.data != 0;
  client_.call([this, enabled](int64_t now_ns) { client_.setEnabled(enabled, now_ns); });
  response.success = 1;
  response.message = enabled ? "tasks may go to nodes" : "the vehicle does everything";
  ROS_INFO_STREAM_NAMED("coordinator", response.message);
  return true;
}

}  // namespace pi_offload
