#include "policies/policies.h"

#include <algorithm>
#include <cmath>

namespace pi_offload
{

namespace
{

/// Who gives up a fallback that would be in time must be so much surer: far out the tail is fatter than the Laplace
/// distribution's, as changes come together.
constexpr double LATE_SCALE = 1.5;

bool usable(const NodeView& node)
{
  return node.connected && node.distance_m <= node.range_m && node.residence_s > 0.0;
}

/// Mean absolute deviation of the response time; its parts are taken as independent.
double deviationOf(const NodeView& node, double extra_queue_s, double least_s)
{
  const double queue = node.queue_s.deviation + extra_queue_s;
  const double square = node.network_s.deviation * node.network_s.deviation +
                        node.service_s.deviation * node.service_s.deviation + queue * queue + least_s * least_s;
  return std::sqrt(square);
}

LocalPlan localPlanOf(const DecisionInput& input, const PolicyOptions& options)
{
  return options.scale_frequency ? scaledLocalPlan(input, options) : localPlan(input);
}

/// Least energy among the places that are done in time with k deviations to spare.
class Deadline : public Policy
{
public:
  explicit Deadline(const PolicyOptions& options) : options_(options) {}
  const char* name() const override { return "deadline"; }

  Decision decide(const DecisionInput& input) override
  {
    const LocalPlan local = localPlanOf(input, options_);
    int best = -1;
    double least = local.time_s <= input.needs.deadline_s ? local.energy_j : HUGE_VAL;
    RemotePlan best_plan;
    for (size_t i = 0; i < input.nodes.size(); ++i)
    {
      const NodeView& node = input.nodes[i];
      if (!usable(node))
      {
        continue;
      }
      const RemotePlan plan = remotePlan(input, node);
      const double bound = std::min(input.needs.deadline_s, options_.residence_share * node.residence_s);
      const double slow_s = plan.time_s() + options_.deviations * deviationOf(node, 0.0, options_.least_deviation_s);
      if (slow_s <= bound && plan.energy_j < least)
      {
        best = static_cast<int>(i);
        best_plan = plan;
        least = plan.energy_j;
      }
    }
    Decision decision = localDecision(local, input, "no node is in time with less energy");
    if (best >= 0)
    {
      decision.node = best;
      decision.expected_s = best_plan.time_s();
      decision.expected_j = best_plan.energy_j;
      decision.expected_misses = 0.0;
      decision.timeout_s = fallbackTimeout(input, options_);
      decision.frequency_ghz = input.computer.frequency_ghz;
      decision.reason = "least energy in time";
    }
    decision.looked_at = input.nodes.size();
    return decision;
  }

private:
  PolicyOptions options_;
};

/// Least expected energy, where a missed deadline costs energy too.
///
/// The response time is taken as Laplace distributed: its mean absolute deviation is its one parameter, so nothing is
/// converted, and its tail falls exponentially as that of a queue does. A normal tail of the same deviation has 0.07 %
/// beyond mean + 4 deviations, the Laplace tail 0.9 %, an exponential queue 1.9 %. What no deviation shows, lost
/// messages and dead nodes, is a constant share.
class ExpectedCost : public Policy
{
public:
  explicit ExpectedCost(const PolicyOptions& options) : options_(options) {}
  const char* name() const override { return "expected_cost"; }

  Decision decide(const DecisionInput& input) override
  {
    Context context;
    context.highest = localPlan(input);
    context.timeout_s = fallbackTimeout(input, options_);
    context.fallback_in_time = context.timeout_s < input.needs.deadline_s;
    context.miss_cost_j = options_.miss_cost_j * std::clamp(input.eta / (1.0 - input.eta), 0.1, 10.0);

    const LocalPlan local = localPlanOf(input, options_);
    Choice vehicle;
    vehicle.decision = localDecision(local, input, "the vehicle is cheapest");
    vehicle.cost_j = local.energy_j + context.miss_cost_j * vehicle.decision.expected_misses;
    Choice best = vehicle;
    Choice previous;
    Choice hopes;    // the node that is cheapest, if its network is as good as it may be
    Choice curious;  // the same as expected
    if (input.previous_node < 0)
    {
      previous = vehicle;
    }
    for (size_t i = 0; i < input.nodes.size(); ++i)
    {
      const NodeView& node = input.nodes[i];
      if (!usable(node))
      {
        continue;
      }
      const Choice choice = weigh(input, node, node.network_s.mean, context, static_cast<int>(i));
      if (node.network_age_s >= options_.curiosity_s && context.fallback_in_time && std::isfinite(choice.cost_j))
      {
        const double hoped_s = std::max(0.0, node.network_s.mean - node.network_s.deviation);
        const Choice hoped = weigh(input, node, hoped_s, context, static_cast<int>(i));
        if (hoped.cost_j < hopes.cost_j)
        {
          hopes = hoped;
          curious = choice;
        }
      }
      if (choice.cost_j < best.cost_j)
      {
        best = choice;
      }
      if (static_cast<int>(i) == input.previous_node)
      {
        previous = choice;
      }
    }
    if (best.decision.node != input.previous_node && best.cost_j > (1.0 - options_.hysteresis) * previous.cost_j)
    {
      best = previous;
      best.decision.reason = "not enough better elsewhere";
    }
    // While the vehicle does all itself it learns nothing of the network.
    if (best.decision.node < 0 && hopes.cost_j < (1.0 - options_.hysteresis) * best.cost_j)
    {
      best = curious;
      best.decision.timeout_s = context.timeout_s;
      best.decision.reason = "to measure the network";
    }
    best.decision.looked_at = input.nodes.size();
    return best.decision;
  }

private:
  struct Context
  {
    LocalPlan highest;
    double timeout_s = 0.0;
    bool fallback_in_time = false;
    double miss_cost_j = 0.0;
  };
  struct Choice
  {
    Decision decision;
    double cost_j = HUGE_VAL;  ///< infinite: not allowed
  };

  /// Probability that no answer is there yet.
  double unanswered(double after_s, double mean_s, double deviation_s) const
  {
    const double x = (after_s - mean_s) / deviation_s;
    const double late = x >= 0.0 ? 0.5 * std::exp(-x) : 1.0 - 0.5 * std::exp(x);
    return options_.loss_share + (1.0 - options_.loss_share) * late;
  }

  Choice weigh(const DecisionInput& input, const NodeView& node, double network_s, const Context& context,
               int index) const
  {
    Choice choice;
    RemotePlan plan = remotePlan(input, node);
    if (network_s < node.network_s.mean)
    {
      plan.network_s = network_s;
    }
    const double mean_s = plan.time_s();
    const bool hoping = network_s < node.network_s.mean;
    const double unsure_queue_s = hoping ? 0.0
                                         : options_.load_growth * node.load_age_s +
                                               (node.leased ? 0.0 : options_.unleased_tasks * plan.service_s);
    const double deviation_s =
        options_.tail_scale * std::max(deviationOf(node, unsure_queue_s, options_.least_deviation_s), 1e-9);
    if (!(mean_s + options_.deviations * deviation_s <= options_.residence_share * node.residence_s))
    {
      return choice;
    }
    // Without fallback a late refusal is a miss as well: it may come when the vehicle cannot do it in time any more.
    const double answered = 1.0 - node.refused_share;
    const double late_scale = context.fallback_in_time ? LATE_SCALE : 1.0;
    const double late = 1.0 - answered * (1.0 - unanswered(input.needs.deadline_s, mean_s, late_scale * deviation_s));
    const double fallback = 1.0 - answered * (1.0 - unanswered(context.timeout_s, mean_s, deviation_s));
    const double late_after_fallback = context.fallback_in_time ? fallback * options_.fallback_miss_share : late;
    const double cost_with = fallback * context.highest.energy_j + context.miss_cost_j * late_after_fallback;
    const double cost_without = late * context.highest.energy_j + context.miss_cost_j * late;
    const bool falls_back = context.fallback_in_time && cost_with <= cost_without;

    Decision& decision = choice.decision;
    decision.node = index;
    decision.frequency_ghz = input.computer.frequency_ghz;
    decision.timeout_s = falls_back ? context.timeout_s : input.needs.deadline_s;
    decision.expected_misses = falls_back ? late_after_fallback : late;
    const double by_vehicle = falls_back ? fallback : late;
    decision.expected_j = plan.energy_j + by_vehicle * context.highest.energy_j;
    decision.expected_s = (1.0 - by_vehicle) * mean_s + by_vehicle * (decision.timeout_s + context.highest.time_s);
    decision.reason = falls_back ? "least expected cost" : "least expected cost, without fallback";
    choice.cost_j = decision.expected_j + context.miss_cost_j * decision.expected_misses;
    return choice;
  }

  PolicyOptions options_;
};

}  // namespace

std::unique_ptr<Policy> makeDeadline(const PolicyOptions& options)
{
  return std::make_unique<Deadline>(options);
}

std::unique_ptr<Policy> makeExpectedCost(const PolicyOptions& options)
{
  return std::make_unique<ExpectedCost>(options);
}

}  // namespace pi_offload
