#include "policies/policies.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace pi_offload
{

namespace
{

/// Time on the vehicle's processor at the highest frequency.
double localWork(const DecisionInput& input)
{
  return input.local_s > 0.0 ? input.local_s : localCost(input.needs, input.computer).time_s;
}

class Local : public Policy
{
public:
  explicit Local(const PolicyOptions& options) : options_(options) {}
  const char* name() const override { return "local"; }
  Decision decide(const DecisionInput& input) override
  {
    const LocalPlan plan = options_.scale_frequency ? scaledLocalPlan(input, options_) : localPlan(input);
    return localDecision(plan, input, "never offloads");
  }

private:
  PolicyOptions options_;
};

class Nearest : public Policy
{
public:
  explicit Nearest(bool anywhere) : anywhere_(anywhere) {}
  const char* name() const override { return anywhere_ ? "nearest_anywhere" : "nearest"; }
  Decision decide(const DecisionInput& input) override
  {
    int nearest = -1;
    double least = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < input.nodes.size(); ++i)
    {
      const NodeView& node = input.nodes[i];
      if ((anywhere_ || node.distance_m <= node.range_m) && node.distance_m < least)
      {
        nearest = static_cast<int>(i);
        least = node.distance_m;
      }
    }
    Decision decision = nearest < 0 ? localDecision(localPlan(input), input, "no node in range")
                                    : uncheckedDecision(input, nearest, "nearest node");
    decision.looked_at = input.nodes.size();
    return decision;
  }

private:
  bool anywhere_;
};

}  // namespace

void PolicyOptions::validate() const
{
  const pi_node::OptionCheck check("policy");
  check.range("miss_cost_j", miss_cost_j, 0.0, 1e6);
  check.range("deviations", deviations, 0.0, 100.0);
  check.positive("residence_share", residence_share);
  check.range("residence_share", residence_share, 0.0, 1.0);
  check.range("hysteresis", hysteresis, 0.0, 0.99);
  check.range("fallback_factor", fallback_factor, 1.0, 10.0);
  check.range("needed_capacity_gcycles", needed_capacity_gcycles, 0.0, 1e12);
  check.range("least_deviation_s", least_deviation_s, 0.0, 10.0);
  check.range("loss_share", loss_share, 0.0, 1.0);
  check.range("fallback_miss_share", fallback_miss_share, 0.0, 1.0);
  check.range("curiosity_s", curiosity_s, 0.0, 1e6);
  check.range("hedge_share", hedge_share, 0.0, 1.0);
  check.range("lost_j", lost_j, 0.0, 1e6);
}

LocalPlan localPlan(const DecisionInput& input)
{
  LocalPlan plan;
  plan.time_s = input.local_backlog_s + localWork(input);
  plan.energy_j = input.local_j > 0.0 ? input.local_j : localCost(input.needs, input.computer).energy_j;
  plan.frequency_ghz = input.computer.frequency_ghz;
  return plan;
}

LocalPlan scaledLocalPlan(const DecisionInput& input, const PolicyOptions& options)
{
  LocalPlan plan = localPlan(input);
  // Cycles that take the measured time at the highest frequency.
  TaskNeeds needs = input.needs;
  needs.work_gcycles = localWork(input) * input.computer.frequency_ghz;
  needs.deadline_s = (input.needs.deadline_s - input.local_backlog_s) / options.fallback_factor;
  if (!(needs.work_gcycles > 0.0))
  {
    return plan;
  }
  const double frequency = bestLocalFrequency(needs, input.computer);
  const Cost scaled = localCost(needs, input.computer, frequency);
  const Cost highest = localCost(needs, input.computer);
  plan.time_s = input.local_backlog_s + scaled.time_s;
  plan.energy_j = highest.energy_j > 0.0 ? plan.energy_j * scaled.energy_j / highest.energy_j : plan.energy_j;
  plan.frequency_ghz = frequency;
  return plan;
}

Decision localDecision(const LocalPlan& plan, const DecisionInput& input, const char* reason)
{
  Decision decision;
  decision.expected_s = plan.time_s;
  decision.expected_j = plan.energy_j;
  decision.expected_misses = plan.time_s <= input.needs.deadline_s ? 0.0 : 1.0;
  decision.frequency_ghz = plan.frequency_ghz;
  decision.reason = reason;
  return decision;
}

RemotePlan remotePlan(const DecisionInput& input, const NodeView& node)
{
  RemoteService service;
  service.frequency_ghz = node.frequency_ghz;
  service.uplink_mbps = node.uplink_mbps;
  service.downlink_mbps = node.downlink_mbps;
  TaskNeeds transfer = input.needs;
  transfer.work_gcycles = 0.0;
  const Cost carried = remoteCost(transfer, input.radio, service);

  RemotePlan plan;
  plan.network_s = node.network_s.mean > 0.0 ? node.network_s.mean : carried.time_s;
  plan.service_s = node.service_s.mean > 0.0  ? node.service_s.mean
                   : node.frequency_ghz > 0.0 ? input.needs.work_gcycles / node.frequency_ghz
                                              : std::numeric_limits<double>::infinity();
  plan.queue_s = node.queue_s.mean;
  // The radio waits during the node's work and the network's time beyond the transfer.
  const double waiting_s = std::max(plan.time_s() - carried.time_s, 0.0);
  plan.energy_j = carried.energy_j + (input.radio.wait_w > 0.0 ? input.radio.wait_w * waiting_s : 0.0);
  return plan;
}

double fallbackTimeout(const DecisionInput& input, const PolicyOptions& options)
{
  const double need_s = std::max(input.local_need_s, localWork(input) * options.fallback_factor);
  const double timeout = input.needs.deadline_s - need_s;
  // The backlog shrinks while the vehicle waits for the answer.
  return timeout > 0.0 && timeout >= input.local_backlog_s ? timeout : input.needs.deadline_s;
}

Decision uncheckedDecision(const DecisionInput& input, int node, const char* reason)
{
  const RemotePlan plan = remotePlan(input, input.nodes[static_cast<size_t>(node)]);
  Decision decision;
  decision.node = node;
  decision.expected_s = plan.time_s();
  decision.expected_j = plan.energy_j;
  decision.expected_misses = plan.time_s() <= input.needs.deadline_s ? 0.0 : 1.0;
  decision.timeout_s = input.needs.deadline_s;
  decision.frequency_ghz = input.computer.frequency_ghz;
  decision.reason = reason;
  return decision;
}

const std::vector<std::string>& policyNames()
{
  static const std::vector<std::string> names{"local", "nearest",  "nearest_anywhere", "paper_literal",
                                              "paper", "deadline", "expected_cost"};
  return names;
}

std::unique_ptr<Policy> makePolicy(const std::string& name, const PolicyOptions& options)
{
  options.validate();
  if (name == "local")
  {
    return std::make_unique<Local>(options);
  }
  if (name == "nearest" || name == "nearest_anywhere")
  {
    return std::make_unique<Nearest>(name == "nearest_anywhere");
  }
  if (name == "paper_literal")
  {
    return makePaperLiteral(options);
  }
  if (name == "paper")
  {
    return makePaper(options);
  }
  if (name == "deadline")
  {
    return makeDeadline(options);
  }
  if (name == "expected_cost")
  {
    return makeExpectedCost(options);
  }
  std::string allowed;
  for (const std::string& known : policyNames())
  {
    allowed += (allowed.empty() ? "" : ", ") + known;
  }
  throw std::invalid_argument("policy \"" + name + "\" is not known, must be one of " + allowed);
}

}  // namespace pi_offload
