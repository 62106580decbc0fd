#include "policies/policies.h"

#include <cmath>
#include <utility>

namespace pi_offload
{

namespace
{

constexpr size_t USUAL_NODES = 1024;

/// Figure 12 as it is printed. Arrays are 1..M, element 0 is no node: K = 0 says that no node has been found and is
/// never read, as T_s is above t_c^i only after K was set. `switch` exchanges two elements. j in C_off^j stands behind
/// its loop and is M there. r without index in equation 6 is read as r_i, both ways.
class PaperLiteral : public Policy
{
public:
  explicit PaperLiteral(const PolicyOptions& options) : needed_(options.needed_capacity_gcycles)
  {
    places_.reserve(USUAL_NODES + 1);
    remote_.reserve(USUAL_NODES + 1);
  }
  const char* name() const override { return "paper_literal"; }

  Decision decide(const DecisionInput& input) override
  {
    const LocalPlan local = localPlan(input);
    const double t_L = local.time_s - input.local_backlog_s;
    const double C_L = printedCost({t_L, local.energy_j}, input.eta);
    prepare(input);

    const size_t M = input.nodes.size();
    size_t looked_at = 0;
    for (size_t i = 1; i + 1 <= M; ++i)
    {
      double T_s = places_[i].t_c;
      size_t K = 0;
      size_t j = 1;
      for (; j + 1 <= M; ++j)
      {
        ++looked_at;
        if (T_s <= places_[j + 1].t_c)
        {
          T_s = places_[j + 1].t_c;
          K = j + 1;
        }
      }
      if (T_s > places_[i].t_c)
      {
        std::swap(places_[i], places_[K]);
      }
      if (places_[i].w > needed_ && remote_[j].c_off < C_L && remote_[i].cost.time_s < t_L)
      {
        Decision decision = uncheckedDecision(input, places_[i].M, "figure 12");
        decision.expected_s = remote_[i].cost.time_s;
        decision.expected_j = remote_[i].cost.energy_j;
        decision.expected_misses = 0.0;
        decision.looked_at = looked_at;
        return decision;
      }
    }
    Decision decision = localDecision(local, input, "figure 12 returns nothing");
    decision.looked_at = looked_at;
    return decision;
  }

private:
  /// What `switch` exchanges.
  struct Place
  {
    double t_c = 0.0;
    double w = 0.0;
    int M = -1;
  };
  /// What it does not.
  struct Remote
  {
    Cost cost;
    double c_off = 0.0;
  };

  void prepare(const DecisionInput& input)
  {
    places_.assign(1, Place());
    remote_.assign(1, Remote());
    for (size_t i = 0; i < input.nodes.size(); ++i)
    {
      const NodeView& node = input.nodes[i];
      places_.push_back({node.printed_residence_s, node.capacity_gcycles, static_cast<int>(i)});
      RemoteService service;
      service.frequency_ghz = node.frequency_ghz;
      service.uplink_mbps = node.uplink_mbps;
      service.downlink_mbps = node.uplink_mbps;
      Radio radio = input.radio;
      radio.wait_w = 0.0;
      radio.tail_w = 0.0;
      const Cost cost = remoteCost(input.needs, radio, service);
      remote_.push_back({cost, printedCost(cost, input.eta)});
    }
  }

  double needed_;
  std::vector<Place> places_;
  std::vector<Remote> remote_;
};

/// What figure 12 means: of all nodes in range that are done before the vehicle leaves and before the deadline, and
/// have the capacity, the cheapest, if it is cheaper than the vehicle. Costs have no units, times have queue and round
/// trip, without an answer the vehicle does the task in time.
class Paper : public Policy
{
public:
  explicit Paper(const PolicyOptions& options) : options_(options) {}
  const char* name() const override { return "paper"; }

  Decision decide(const DecisionInput& input) override
  {
    const LocalPlan local = localPlan(input);
    const double deadline = input.needs.deadline_s;
    int best = -1;
    double least = normalisedCost({local.time_s, local.energy_j}, deadline, local.energy_j, input.eta);
    if (!(local.time_s <= deadline))
    {
      least = HUGE_VAL;
    }
    RemotePlan best_plan;
    for (size_t i = 0; i < input.nodes.size(); ++i)
    {
      const NodeView& node = input.nodes[i];
      const RemotePlan plan = remotePlan(input, node);
      const double t_off = plan.time_s();
      if (!node.connected || !(node.distance_m <= node.range_m) || !(t_off <= node.residence_s) ||
          !(t_off <= deadline) || !(node.capacity_gcycles >= options_.needed_capacity_gcycles))
      {
        continue;
      }
      const double c_off = normalisedCost({t_off, plan.energy_j}, deadline, local.energy_j, input.eta);
      if (c_off < least)
      {
        best = static_cast<int>(i);
        best_plan = plan;
        least = c_off;
      }
    }
    Decision decision = localDecision(local, input, "no node is cheaper");
    if (best >= 0)
    {
      decision = uncheckedDecision(input, best, "cheapest node in time");
      decision.timeout_s = fallbackTimeout(input, options_);
    }
    decision.looked_at = input.nodes.size();
    return decision;
  }

private:
  PolicyOptions options_;
};

}  // namespace

std::unique_ptr<Policy> makePaperLiteral(const PolicyOptions& options)
{
  return std::make_unique<PaperLiteral>(options);
}

std::unique_ptr<Policy> makePaper(const PolicyOptions& options)
{
  return std::make_unique<Paper>(options);
}

}  // namespace pi_offload
