#include "policies/policies.h"

#include <algorithm>
#include <cmath>

namespace pi_offload
{

namespace
{

bool usable(const NodeView& node)
{
  return node.connected && node.distance_m <= node.range_m && node.residence_s > 0.0;
}

/// Probability that no answer comes within after_s.
double unanswered(const NodeView& node, double after_s, const Estimate& answer, double loss_share)
{
  static const AnswerTimes laplace;
  return (node.times != nullptr ? *node.times : laplace).beyond((after_s - answer.mean) / answer.deviation, loss_share);
}

/// Mean absolute deviation of the answer time, with independent parts.
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

/// Least energy among the places that meet the deadline with k deviations to spare.
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

/// Least expected energy, with a price in energy for a missed deadline.
///
/// The response time is taken as Laplace distributed. Its one parameter is the mean absolute deviation, and its tail
/// falls exponentially like that of a queue: beyond mean + 4 deviations lie 0.9 % (normal: 0.07 %, exponential queue:
/// 1.9 %). Lost messages and dead nodes are a constant part (loss_share).
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
    context.miss_cost_j = missCost(options_, input.eta);

    const LocalPlan local = localPlanOf(input, options_);
    Choice vehicle;
    vehicle.decision = localDecision(local, input, "the vehicle is cheapest");
    vehicle.cost_j = local.energy_j + context.miss_cost_j * vehicle.decision.expected_misses;
    Choice best = vehicle;
    Choice previous;
    Choice hopes;    // the cheapest node if its network is one deviation better than expected
    Choice curious;  // the same node as expected
    if (input.previous_node < 0)
    {
      previous = vehicle;
    }
    for (size_t i = 0; i < input.nodes.size(); ++i)
    {
      const NodeView& node = input.nodes[i];
      if (!usable(node) || node.lost)
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
    // Ripples change neither node nor back from the vehicle; the vehicle is never dearer than expected.
    if (best.decision.node != input.previous_node && previous.cost_j <= vehicle.cost_j &&
        best.cost_j > (1.0 - options_.hysteresis) * previous.cost_j)
    {
      best = previous;
      best.decision.reason = "not enough better elsewhere";
    }
    // A vehicle that does all tasks itself learns nothing about the network.
    if (best.decision.node < 0 && hopes.cost_j < (1.0 - options_.hysteresis) * best.cost_j)
    {
      best = curious;
      best.decision.timeout_s = context.timeout_s;
      best.decision.reason = "to measure the network";
    }
    best.decision.looked_at = input.nodes.size();
    if (best.decision.node >= 0)
    {
      const NodeView& node = input.nodes[static_cast<size_t>(best.decision.node)];
      const Estimate answer = answerTime(input, node, options_);
      best.decision.hedge_s =
          options_.hedge_share > 0.0 && node.times != nullptr
              ? answer.mean + answer.deviation * node.times->quantile(options_.hedge_share, options_.loss_share)
              : 0.0;
    }
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

  Choice weigh(const DecisionInput& input, const NodeView& node, double network_s, const Context& context,
               int index) const
  {
    Choice choice;
    const RemotePlan plan = remotePlan(input, node);
    Estimate answer = answerTime(input, node, options_);
    const bool hoping = network_s < node.network_s.mean;
    if (hoping)
    {
      answer.mean -= node.network_s.mean - network_s;
      answer.deviation = std::hypot(node.service_s.deviation, options_.least_deviation_s);
    }
    if (!(answer.mean + options_.deviations * answer.deviation <= options_.residence_share * node.residence_s))
    {
      return choice;
    }
    // A late refusal is a miss too, without fallback: the vehicle may have no time left for the task.
    const double until_s = context.fallback_in_time ? context.timeout_s : input.needs.deadline_s;
    const double late = unanswered(node, until_s, answer, options_.loss_share);
    const double by_vehicle = 1.0 - (1.0 - node.refused_share) * (1.0 - late);

    Decision& decision = choice.decision;
    decision.node = index;
    decision.frequency_ghz = input.computer.frequency_ghz;
    decision.timeout_s = until_s;
    decision.expected_misses = context.fallback_in_time ? by_vehicle * options_.fallback_miss_share : by_vehicle;
    // Without an answer the radio waits until the vehicle has done the task. A refusal comes at once.
    const double awaited_s = std::max(0.0, until_s + context.highest.time_s - answer.mean);
    decision.expected_j =
        plan.energy_j + by_vehicle * context.highest.energy_j + late * input.radio.wait_w * awaited_s;
    decision.expected_s = (1.0 - by_vehicle) * answer.mean + by_vehicle * (until_s + context.highest.time_s);
    decision.reason = "least expected cost";
    choice.cost_j = decision.expected_j + context.miss_cost_j * decision.expected_misses;
    return choice;
  }

  PolicyOptions options_;
};

}  // namespace

Estimate answerTime(const DecisionInput& input, const NodeView& node, const PolicyOptions& options)
{
  const RemotePlan plan = remotePlan(input, node);
  const double unsure_queue_s =
      options.load_growth * node.load_age_s + (node.leased ? 0.0 : options.unleased_tasks * plan.service_s);
  return {plan.time_s(), options.tail_scale * std::max(deviationOf(node, unsure_queue_s, options.least_deviation_s), 1e-9)};
}

double missCost(const PolicyOptions& options, double eta)
{
  return options.miss_cost_j * std::clamp(eta / (1.0 - eta), 0.1, 10.0);
}

Hedge hedgeOf(const DecisionInput& input, const PolicyOptions& options, double fallback_s,
              const std::function<double(double)>& late)
{
  Hedge best;
  double most_j = 0.0;
  for (size_t i = 0; i < input.nodes.size(); ++i)
  {
    const NodeView& node = input.nodes[i];
    const Estimate answer = answerTime(input, node, options);
    if (!usable(node) || node.lost ||
        !(answer.mean + options.deviations * answer.deviation <= options.residence_share * node.residence_s))
    {
      continue;
    }
    const double answers = (1.0 - node.refused_share) * (1.0 - unanswered(node, fallback_s, answer, options.loss_share));
    const double saved_j = late(fallback_s) * answers *
                           (localPlan(input).energy_j + missCost(options, input.eta) * options.fallback_miss_share);
    const double energy_j = remotePlan(input, node).energy_j;
    // An earlier result is worth the budget, too.
    const double gain_j = saved_j + late(answer.mean) * energy_j - energy_j;
    if (gain_j > most_j)
    {
      most_j = gain_j;
      best = {static_cast<int>(i), energy_j};
    }
  }
  return best;
}

std::unique_ptr<Policy> makeDeadline(const PolicyOptions& options)
{
  return std::make_unique<Deadline>(options);
}

std::unique_ptr<Policy> makeExpectedCost(const PolicyOptions& options)
{
  return std::make_unique<ExpectedCost>(options);
}

}  // namespace pi_offload
