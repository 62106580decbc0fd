#include "policies/policies.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace pi_offload
{

namespace
{

bool usable(const NodeView& node)
{
  return node.connected && node.distance_m <= node.range_m && node.residence_s > 0.0;
}

/// Instants at which a hedge or a fallback may begin.
constexpr size_t INSTANTS = 16;

/// Probability that no answer comes within after_s.
double unanswered(const NodeView& node, double after_s, const Estimate& answer, double loss_share)
{
  static const AnswerTimes laplace;
  return (node.times != nullptr ? *node.times : laplace).beyond((after_s - answer.mean) / answer.deviation, loss_share);
}

/// Whether the vehicle stays in range for the task.
bool staysInRange(const NodeView& node, const Estimate& answer, const PolicyOptions& options)
{
  return answer.mean + options.deviations * answer.deviation <= options.residence_share * node.residence_s;
}

/// Expected energy and misses from now on, while answers are awaited, with the best time of the fallback.
struct Wait
{
  double cost_j = HUGE_VAL;
  double fallback_s = 0.0;
};

/// Probabilities that no answer came, at instants of equal distance; beyond the last one it stays.
class Curve
{
public:
  Curve() = default;
  /// @param after  probability that no answer comes until then
  template <typename After>
  Curve(double step_s, const After& after)
  {
    for (size_t i = 0; i < values_.size(); ++i)
    {
      values_[i] = after(static_cast<double>(i) * step_s);
    }
  }
  double operator[](size_t i) const { return values_[std::min(i, values_.size() - 1)]; }

private:
  std::array<double, 2 * INSTANTS + 1> values_{};
};

/// What waiting and the fallback cost.
struct Prices
{
  double step_s = 0.0;      ///< between instants; the latest fallback is INSTANTS of them from now
  size_t earliest = 0;      ///< instant at which the vehicle is free for a fallback
  size_t running = 0;       ///< instants that the vehicle takes for the task
  double fallback_j = 0.0;  ///< of the vehicle's computer, and of misses
  double wait_w = 0.0;
};

/// The fallback begins when waiting for an answer costs more than it may save. @param from  instant of the decision,
/// at which `now` is the probability that no answer came: costs are per such case.
template <typename Unanswered>
Wait bestWait(const Prices& prices, size_t from, double requests, const Unanswered& unanswered_at)
{
  std::array<double, 4 * INSTANTS> waited{};  // energy until the instant
  const double per_step_j = requests * prices.wait_w * prices.step_s;
  for (size_t i = from + 1; i < waited.size(); ++i)
  {
    waited[i] = waited[i - 1] + per_step_j * 0.5 * (unanswered_at(i - 1) + unanswered_at(i));
  }
  Wait best;
  for (size_t i = std::max(from, prices.earliest); i <= INSTANTS; ++i)
  {
    const size_t end = std::min(i + prices.running, waited.size() - 1);
    const double cost_j = waited[end] + unanswered_at(i) * prices.fallback_j;
    if (cost_j < best.cost_j)
    {
      best = {cost_j, static_cast<double>(i) * prices.step_s};
    }
  }
  return best;
}

/// Mean absolute deviation of the answer time, with independent parts.
double deviationOf(const NodeView& node, double least_s)
{
  const double square = node.network_s.deviation * node.network_s.deviation +
                        node.service_s.deviation * node.service_s.deviation +
                        node.queue_s.deviation * node.queue_s.deviation + least_s * least_s;
  return std::sqrt(square);
}

/// Energy of a request beyond what waiting costs from now on.
double sendingEnergy(const DecisionInput& input, const NodeView& node)
{
  const Radio& radio = input.radio;
  const double sending_s = input.needs.input_mbit / node.uplink_mbps;
  const double receiving_s = input.needs.output_mbit / node.downlink_mbps;
  return (radio.transmit_w - radio.wait_w) * sending_s + (radio.receive_w - radio.wait_w) * receiving_s +
         radio.tail_w * radio.tail_s;
}

/// @param latest_s  from now, of the fallback
Prices pricesOf(const DecisionInput& input, const PolicyOptions& options, double latest_s)
{
  const LocalPlan vehicle = localPlan(input);
  Prices prices;
  prices.step_s = latest_s / static_cast<double>(INSTANTS);
  prices.earliest = static_cast<size_t>(std::ceil(std::min(input.local_backlog_s, latest_s) / prices.step_s - 1e-6));
  prices.running =
      static_cast<size_t>(std::min(std::ceil((vehicle.time_s - input.local_backlog_s) / prices.step_s), 1e3));
  prices.fallback_j = vehicle.energy_j + missCost(options, input.eta) * options.fallback_miss_share;
  prices.wait_w = input.radio.wait_w;
  return prices;
}

/// Probability that a second request brings no answer.
Curve reserveOf(const DecisionInput& input, const NodeView& node, double step_s, const PolicyOptions& options)
{
  const Estimate answer = answerTime(input, node, options);
  return {step_s, [&](double after_s)
          {
            const double late = unanswered(node, after_s, answer, options.loss_share);
            return 1.0 - (1.0 - node.refused_share) * (1.0 - late);
          }};
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
      const double slow_s = plan.time_s() + options_.deviations * deviationOf(node, options_.least_deviation_s);
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
/// The answer time has the distribution of the answers that were seen (AnswerTimes), in units of its mean absolute
/// deviation. Before there are any it is Laplace's, whose tail falls exponentially like that of a queue: beyond
/// mean + 4 deviations lie 0.9 % (normal: 0.07 %, exponential queue: 1.9 %), with lost messages and dead nodes as a
/// constant part (loss_share).
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
    Choice remote;    // the cheapest node
    Choice second;    // the next one
    Choice previous;  // the node of the last task
    Choice hopes;     // the cheapest node if its network is one deviation better than expected
    Choice curious;   // the same node as expected
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
      if (static_cast<int>(i) == input.previous_node)
      {
        previous = choice;
      }
      if (choice.cost_j < remote.cost_j)
      {
        second = std::exchange(remote, choice);
      }
      else if (choice.cost_j < second.cost_j)
      {
        second = choice;
      }
    }
    // Ripples change no node. They hold no task at a node that is dearer than the vehicle.
    if (std::isfinite(previous.cost_j) && remote.decision.node != previous.decision.node &&
        remote.cost_j > (1.0 - options_.hysteresis) * previous.cost_j)
    {
      second = std::exchange(remote, previous);
      remote.decision.reason = "not enough better elsewhere";
    }
    if (context.fallback_in_time && std::isfinite(remote.cost_j))
    {
      plan(input, context, std::isfinite(second.cost_j) ? second.decision.node : -1, &remote);
    }
    Choice best = remote.cost_j < vehicle.cost_j ? remote : vehicle;
    // A vehicle that does all tasks itself learns nothing about the network.
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
    if (!staysInRange(node, answer, options_))
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
    decision.expected_j = plan.energy_j + by_vehicle * context.highest.energy_j + late * input.radio.wait_w * awaited_s;
    decision.expected_s = (1.0 - by_vehicle) * answer.mean + by_vehicle * (until_s + context.highest.time_s);
    decision.reason = "least expected cost";
    choice.cost_j = decision.expected_j + context.miss_cost_j * decision.expected_misses;
    return choice;
  }

  /// When the fallback begins, and when the second node is asked if no answer came. @param second  index; -1: none
  void plan(const DecisionInput& input, const Context& context, int second, Choice* choice) const
  {
    Decision& decision = choice->decision;
    const NodeView& node = input.nodes[static_cast<size_t>(decision.node)];
    const Prices prices = pricesOf(input, options_, context.timeout_s);
    const Estimate answer = answerTime(input, node, options_);
    const Curve first(prices.step_s,
                      [&](double after_s) { return unanswered(node, after_s, answer, options_.loss_share); });
    const auto alone = [&](size_t i) { return first[i]; };
    Wait best = bestWait(prices, 0, 1.0, alone);
    if (second >= 0 && options_.hedge_share > 0.0)
    {
      const NodeView& other = input.nodes[static_cast<size_t>(second)];
      const Curve reserve = reserveOf(input, other, prices.step_s, options_);
      const double sending_j = sendingEnergy(input, other);
      double waited_j = 0.0;
      for (size_t at = 1; at < INSTANTS; ++at)
      {
        waited_j += prices.wait_w * prices.step_s * 0.5 * (first[at - 1] + first[at]);
        Wait wait = bestWait(prices, at, 2.0, [&](size_t i) { return first[i] * reserve[i - at]; });
        wait.cost_j += waited_j + first[at] * sending_j;
        if (wait.cost_j < best.cost_j)
        {
          best = wait;
          decision.hedge_s = static_cast<double>(at) * prices.step_s;
        }
      }
    }
    // A refusal comes at once.
    const double taken = 1.0 - node.refused_share;
    const double late = unanswered(node, best.fallback_s, answer, options_.loss_share);
    choice->cost_j = sendingEnergy(input, node) + taken * best.cost_j + node.refused_share * prices.fallback_j;
    decision.timeout_s = best.fallback_s;
    decision.expected_misses = (1.0 - taken * (1.0 - late)) * options_.fallback_miss_share;
    decision.expected_j = choice->cost_j - context.miss_cost_j * decision.expected_misses;
  }

  PolicyOptions options_;
};

}  // namespace

Estimate answerTime(const DecisionInput& input, const NodeView& node, const PolicyOptions& options)
{
  const RemotePlan plan = remotePlan(input, node);
  return {plan.time_s(), std::max(deviationOf(node, options.least_deviation_s), 1e-9)};
}

double missCost(const PolicyOptions& options, double eta)
{
  return options.miss_cost_j * std::clamp(eta / (1.0 - eta), 0.1, 10.0);
}

Hedge hedgeOf(const DecisionInput& input, const PolicyOptions& options, double latest_s,
              const std::function<double(double)>& late)
{
  const Prices prices = pricesOf(input, options, latest_s);
  const Curve first(prices.step_s, late);
  double least_j = bestWait(prices, 0, 1.0, [&](size_t i) { return first[i]; }).cost_j;
  Hedge best;
  for (size_t n = 0; n < input.nodes.size(); ++n)
  {
    const NodeView& node = input.nodes[n];
    if (!usable(node) || node.lost || !staysInRange(node, answerTime(input, node, options), options))
    {
      continue;
    }
    const Curve reserve = reserveOf(input, node, prices.step_s, options);
    const Wait wait = bestWait(prices, 0, 2.0, [&](size_t i) { return first[i] * reserve[i]; });
    const double cost_j = sendingEnergy(input, node) + wait.cost_j;
    if (cost_j < least_j)
    {
      least_j = cost_j;
      best = {static_cast<int>(n), remotePlan(input, node).energy_j, wait.fallback_s};
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
