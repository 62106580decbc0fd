// The twelve defects of figure 12 and equations 3 to 8 as printed (docs/design/offload.md): each test shows
// paper_literal failing, and what replaces it right.

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <string>

#include "engine/offload_engine.h"
#include "policies/policy.h"
#include "policies/residence.h"
#include "server/admission.h"

namespace
{

using namespace pi_offload;

/// In range for `t_c` seconds yet; 0.0434 s and 0.02916 J for a picture, where the vehicle needs 0.1 s and 0.42 J.
NodeView node(double t_c, double capacity = 10.0)
{
  NodeView view;
  view.id = "node";
  view.connected = true;
  view.distance_m = 30.0;
  view.range_m = 100.0;
  view.residence_s = t_c;
  view.printed_residence_s = t_c;
  view.capacity_gcycles = capacity;
  view.frequency_ghz = 10.0;
  view.uplink_mbps = 20.0;
  view.downlink_mbps = 20.0;
  return view;
}

/// Its processor is slower than the vehicle's: 0.2144 s for a picture, after the deadline.
NodeView slowNode(double t_c)
{
  NodeView view = node(t_c);
  view.frequency_ghz = 1.0;
  return view;
}

DecisionInput picture(std::vector<NodeView> nodes)
{
  DecisionInput input;
  input.needs.work_gcycles = 0.19;
  input.needs.input_mbit = 0.48;
  input.needs.output_mbit = 0.008;
  input.needs.deadline_s = 0.2;
  input.nodes = std::move(nodes);
  return input;
}

int chosen(const std::string& policy, const DecisionInput& input, double needed_capacity = 1.0)
{
  PolicyOptions options;
  options.needed_capacity_gcycles = needed_capacity;
  return makePolicy(policy, options)->decide(input).node;
}

TEST(PaperDefects, Defect1LeavesOutTheLastRank)
{
  EXPECT_EQ(chosen("paper_literal", picture({node(20.0)})), -1) << "the only node is never tried";
  EXPECT_EQ(chosen("paper", picture({node(20.0)})), 0);

  const DecisionInput last_is_right = picture({node(30.0, 0.0), node(20.0, 0.0), node(10.0)});
  EXPECT_EQ(chosen("paper_literal", last_is_right), -1) << "nor is the last of several";
  EXPECT_EQ(chosen("paper", last_is_right), 2);
}

TEST(PaperDefects, Defect2BringsBackNodesThatWereRejected)
{
  const DecisionInput third_is_right = picture({node(4.0, 0.0), node(3.0, 0.0), node(2.0), node(1.0, 0.0)});
  EXPECT_EQ(chosen("paper_literal", third_is_right), -1) << "the inner loop swaps node 2 back to place 3";
  EXPECT_EQ(chosen("paper", third_is_right), 2);
}

TEST(PaperDefects, Defect3TestsTheFiguresOfAnotherNode)
{
  // t_off stays where it was: that of node 1 is tested, and node 2 is returned.
  const DecisionInput stale = picture({node(10.0), slowNode(20.0)});
  EXPECT_EQ(chosen("paper_literal", stale), 1) << "a node that is slower than the deadline";
  EXPECT_EQ(chosen("paper", stale), 0);

  // C_off^j behind its loop is that of the last node.
  NodeView dear = node(1.0);
  dear.uplink_mbps = 0.5;
  const DecisionInput dead_index = picture({node(20.0), node(10.0), dear});
  EXPECT_EQ(chosen("paper_literal", dead_index), -1) << "as the last node is dear";
  EXPECT_EQ(chosen("paper", dead_index), 0);
}

TEST(PaperDefects, Defect4TakesNodesThatAreOutOfRange)
{
  NodeView here = node(0.0);
  NodeView ahead = node(0.0);
  const Point vehicle{0.0, 0.0};
  const double east = M_PI_2;
  const auto place = [&](NodeView& view, const Point& position)
  {
    view.distance_m = std::hypot(position.x - vehicle.x, position.y - vehicle.y);
    view.residence_s = straightResidence(vehicle, east, 3.0, position, view.range_m).now_s;
    view.printed_residence_s = printedResidence(vehicle, east, 3.0, position, view.range_m);
  };
  place(here, {20.0, 0.0});
  place(ahead, {400.0, 0.0});
  EXPECT_GT(ahead.printed_residence_s, here.printed_residence_s) << "equation 8 prefers what is far away";
  EXPECT_EQ(chosen("paper_literal", picture({here, ahead})), 1);
  EXPECT_EQ(chosen("paper", picture({here, ahead})), 0);
  EXPECT_EQ(chosen("paper", picture({ahead, ahead})), -1);
}

TEST(PaperDefects, Defect5TakesNodesThatAreLeftBeforeTheAnswer)
{
  const DecisionInput leaving = picture({node(0.02), node(0.01)});
  EXPECT_EQ(chosen("paper_literal", leaving), 0) << "0.0434 s of work in 0.02 s of range";
  EXPECT_EQ(chosen("paper", leaving), -1);
}

TEST(PaperDefects, Defect6RefusesWhatIsSlowerThanTheVehicle)
{
  // Speech as in section VII.D: 200 ms on the node, 100 ms on the vehicle, 500 ms are allowed.
  DecisionInput speech = picture({node(20.0), node(20.0)});
  speech.kind = TaskKind::SPEECH;
  speech.needs.deadline_s = 0.5;
  for (NodeView& view : speech.nodes)
  {
    view.frequency_ghz = 1.0;
  }
  EXPECT_EQ(chosen("paper_literal", speech), -1);
  EXPECT_EQ(chosen("paper", speech), 0) << "in time, with a fourteenth of the energy";
}

TEST(PaperDefects, Defect7ReservesNothing)
{
  EXPECT_EQ(chosen("paper_literal", picture({node(20.0, 1.0), node(10.0, 1.0)})), -1) << "just enough is too little";
  EXPECT_EQ(chosen("paper", picture({node(20.0, 1.0), node(10.0, 1.0)})), 0);

  // Two vehicles at once see capacity for one.
  DecisionInput first = picture({node(20.0, 1.5), node(10.0, 1.5)});
  DecisionInput second = first;
  EXPECT_EQ(chosen("paper_literal", first), 0);
  EXPECT_EQ(chosen("paper_literal", second), 0) << "both pass";

  // A lease is given to one of them: its tasks go before those that wait.
  AdmissionOptions options;
  options.workers = 1;
  options.first_service_s = {0.07, 0.07};
  Admission admission(options);
  constexpr double PICTURES_HZ = 10.0;
  EXPECT_EQ(admission.lease("first", TaskKind::DETECTION, PICTURES_HZ, 1), PICTURES_HZ);
  EXPECT_EQ(admission.lease("second", TaskKind::DETECTION, PICTURES_HZ, 1), 0.0);
  ServerTask waiting;
  waiting.ticket = 1;
  waiting.vehicle = "third";
  waiting.kind = TaskKind::DETECTION;
  waiting.arrived_ns = 1;
  waiting.remaining_s = 1.0;
  ASSERT_EQ(admission.submit(waiting), Admission::Verdict::TAKEN);
  for (auto [input, vehicle] : {std::pair(&first, "first"), std::pair(&second, "second")})
  {
    const NodeAdvertisement advertisement = admission.advertisement(vehicle, 1);
    const NodeAdvertisement::OfKind& said = advertisement.of_kind[static_cast<size_t>(TaskKind::DETECTION)];
    NodeView& wanted = input->nodes[0];
    wanted.service_s = {said.service_s, 0.002};
    wanted.queue_s = {said.queue_s, 0.002};
    NodeView& slower = input->nodes[1];  // nobody else wants it
    slower.service_s = {0.072, 0.002};
    input->local_s = 0.09;
  }
  EXPECT_EQ(chosen("expected_cost", first), 0);
  EXPECT_EQ(chosen("expected_cost", second), 1) << "who has no lease goes where nobody waits";
}

TEST(PaperDefects, Defect8LeavesOutMostOfTimeAndEnergy)
{
  // One r for both directions.
  NodeView slow_answer = node(20.0);
  slow_answer.downlink_mbps = 0.02;
  EXPECT_EQ(chosen("paper_literal", picture({slow_answer, slow_answer})), 0) << "0.4 s for the answer alone";
  EXPECT_EQ(chosen("paper", picture({slow_answer, slow_answer})), -1);

  // No queue, no round trip.
  NodeView busy = node(20.0);
  busy.queue_s.mean = 0.3;
  EXPECT_EQ(chosen("paper_literal", picture({busy, busy})), 0);
  EXPECT_EQ(chosen("paper", picture({busy, busy})), -1);
  NodeView distant = node(20.0);
  distant.network_s.mean = 0.3;
  EXPECT_EQ(chosen("paper_literal", picture({distant, distant})), 0);
  EXPECT_EQ(chosen("paper", picture({distant, distant})), -1);

  // The radio waits and has a tail: 0.76 J instead of 0.03 J.
  DecisionInput hungry = picture({node(20.0), node(20.0)});
  hungry.eta = 0.1;
  hungry.radio.wait_w = 1.0;
  hungry.radio.tail_w = 1.0;
  hungry.radio.tail_s = 0.7;
  EXPECT_EQ(chosen("paper_literal", hungry), 0);
  EXPECT_EQ(chosen("paper", hungry), -1);
}

TEST(PaperDefects, Defect9TakesTheLongestStayWhateverItCosts)
{
  NodeView dear = node(20.0);
  dear.uplink_mbps = 7.0;
  dear.downlink_mbps = 7.0;
  const DecisionInput input = picture({dear, node(15.0)});
  EXPECT_EQ(chosen("paper_literal", input), 0)
      << "three times the energy, for 5 s that a task of 0.04 s has no use for";
  EXPECT_EQ(chosen("paper", input), 1);
}

/// Drives an engine whose one node answers to probes but never to a task. The vehicle needs 0.1 s for a picture.
class SilentNode
{
public:
  explicit SilentNode(const std::string& policy) : engine_(options(policy), actions())
  {
    // Two nodes: figure 12 never takes the only one.
    for (const char* id : {"a", "b"})
    {
      NodeDescription description;
      description.id = id;
      description.range_m = 100.0;
      description.capacity_gcycles = 10.0;
      engine_.setNode(description, now_ns_);
    }
    VehicleState vehicle;
    vehicle.known = true;
    vehicle.position = {0.0, -50.0};
    vehicle.speed = 3.0;
    engine_.setVehicle(vehicle);
    engine_.onTime(now_ns_);
    for (const auto& [id, request] : std::map<std::string, uint64_t>(probes_))
    {
      engine_.onProbeReply(id, request, 0.002, idle(), now_ns_);
    }
  }

  Outcome send()
  {
    Task task;
    task.id = 1;
    task.created_ns = now_ns_;
    task.deadline_s = 0.2;
    task.input_bytes = 60000;
    const Decision decision = engine_.submit(task, now_ns_);
    EXPECT_GE(decision.node, 0) << decision.reason;
    // At most all that happens until the task has its end.
    for (int events = 0; outcomes_.empty() && events < 1000; ++events)
    {
      now_ns_ = std::min(engine_.nextTime(), local_ends_ns_);
      if (now_ns_ == local_ends_ns_)
      {
        local_ends_ns_ = INT64_MAX;
        engine_.onLocalDone(1, 0.1, now_ns_);
      }
      else
      {
        engine_.onTime(now_ns_);
      }
    }
    return outcomes_.empty() ? Outcome() : outcomes_.front();
  }
  size_t outcomes() const { return outcomes_.size(); }

private:
  static EngineOptions options(const std::string& policy)
  {
    EngineOptions options;
    options.policy_name = policy;
    options.policy.needed_capacity_gcycles = 1.0;
    for (TaskNeeds& needs : options.needs)
    {
      needs = picture({}).needs;
    }
    return options;
  }

  static NodeAdvertisement idle()
  {
    NodeAdvertisement advertisement;
    for (NodeAdvertisement::OfKind& of_kind : advertisement.of_kind)
    {
      of_kind.served = true;
      of_kind.service_s = 0.019;
      of_kind.lease_until_s = 1.0;
      of_kind.lease_rate_hz = 20.0;
    }
    advertisement.capacity_gcycles = 10.0;
    return advertisement;
  }

  OffloadEngine::Actions actions()
  {
    OffloadEngine::Actions actions;
    actions.send = [](const std::string&, uint64_t, const Task&) { return true; };
    actions.probe = [this](const std::string& id, uint64_t request)
    {
      probes_[id] = request;
      return true;
    };
    actions.run_local = [this](const Task&, double) { local_ends_ns_ = now_ns_ + 100000000; };
    actions.cancel = [](const std::string&, uint64_t) {};
    actions.deliver = [this](const Outcome& outcome) { outcomes_.push_back(outcome); };
    return actions;
  }

  int64_t now_ns_ = 1000000000;
  int64_t local_ends_ns_ = INT64_MAX;
  std::map<std::string, uint64_t> probes_;
  std::vector<Outcome> outcomes_;
  OffloadEngine engine_;
};

TEST(PaperDefects, Defect10HasNoTimeoutAndNoFallback)
{
  SilentNode literal("paper_literal");
  EXPECT_FALSE(literal.send().by_deadline);
  for (const char* policy : {"paper", "deadline", "expected_cost"})
  {
    SilentNode repaired(policy);
    const Outcome outcome = repaired.send();
    EXPECT_EQ(outcome.how, Outcome::How::FALLBACK) << policy;
    EXPECT_TRUE(outcome.by_deadline) << policy;
    EXPECT_EQ(repaired.outcomes(), 1u) << policy;
  }
}

TEST(PaperDefects, Defect10HasNoHysteresis)
{
  // Two nodes that are as good, but for a ripple in what is measured.
  for (const char* policy : {"paper_literal", "expected_cost"})
  {
    DecisionInput input = picture({node(20.0), node(20.0)});
    int changes = 0;
    int previous = 0;
    for (int task = 0; task < 100; ++task)
    {
      for (int i = 0; i < 2; ++i)
      {
        const double ripple = task % 2 == i ? 1.005 : 0.995;
        NodeView& view = input.nodes[static_cast<size_t>(i)];
        view.printed_residence_s = view.residence_s = 20.0 * ripple;
        view.uplink_mbps = 20.0 * ripple;
      }
      input.previous_node = previous;
      const int now = chosen(policy, input);
      ASSERT_GE(now, 0) << policy;
      changes += now != previous ? 1 : 0;
      previous = now;
    }
    EXPECT_EQ(changes, std::string(policy) == "paper_literal" ? 99 : 0) << policy;
  }
}

TEST(PaperDefects, Defect11TakesTheLastOfEqualOnes)
{
  NodeView last = node(20.0);
  last.uplink_mbps = 15.0;
  const DecisionInput tie = picture({node(0.01), node(20.0), last});
  EXPECT_EQ(chosen("paper_literal", tie), 2) << "whatever it costs";
  EXPECT_EQ(chosen("paper", tie), 1);
  EXPECT_EQ(chosen("paper", picture({node(20.0), node(20.0)})), 0) << "equal in everything: the first, always";
}

TEST(PaperDefects, Defect12SortsForAMaximumAndReturnsNothing)
{
  const DecisionInput none = picture(std::vector<NodeView>(100, node(20.0, 0.0)));
  PolicyOptions options;
  options.needed_capacity_gcycles = 1.0;
  EXPECT_EQ(makePolicy("paper_literal", options)->decide(none).looked_at, 99u * 99u);
  const Decision decision = makePolicy("paper", options)->decide(none);
  EXPECT_EQ(decision.looked_at, 100u);
  EXPECT_EQ(decision.node, -1);
  EXPECT_NEAR(decision.expected_s, 0.1, 1e-9) << "the vehicle, and what that means, is said";
  EXPECT_EQ(decision.frequency_ghz, 1.9);
}

/// How often figure 12 returns something else than the node of longest stay that can do the task, and how often one
/// that cannot.
struct Shares
{
  double wrong = 0.0;
  double infeasible = 0.0;
};

/// @param stale  a node can do the task if it has the capacity and a fast processor, each with probability sqrt(0.5);
///   t_off is not swapped. Else capacity alone decides, which is. C_off^j is below C_L in both cases: a model in which
///   it is not (slow links) gives other figures.
Shares sharesOf(int M, bool stale)
{
  PolicyOptions options;
  options.needed_capacity_gcycles = 1.0;
  const std::unique_ptr<Policy> literal = makePolicy("paper_literal", options);
  std::mt19937 random(static_cast<unsigned>(M));
  std::uniform_real_distribution<double> stay(0.0, 30.0);
  std::bernoulli_distribution can(stale ? std::sqrt(0.5) : 0.5);
  constexpr int EXAMPLES = 40000;
  DecisionInput input = picture(std::vector<NodeView>(static_cast<size_t>(M)));
  std::vector<bool> feasible(static_cast<size_t>(M));
  int wrong = 0;
  int infeasible = 0;
  for (int example = 0; example < EXAMPLES; ++example)
  {
    int best = -1;
    double longest = -1.0;
    for (int i = 0; i < M; ++i)
    {
      const bool capacity = can(random);
      const bool fast = !stale || can(random);
      const double t_c = stay(random);
      NodeView view = fast ? node(t_c) : slowNode(t_c);
      view.capacity_gcycles = capacity ? 10.0 : 0.0;
      input.nodes[static_cast<size_t>(i)] = view;
      feasible[static_cast<size_t>(i)] = capacity && fast;
      if (capacity && fast && t_c > longest)
      {
        best = i;
        longest = t_c;
      }
    }
    const int found = literal->decide(input).node;
    wrong += found != best ? 1 : 0;
    infeasible += found >= 0 && !feasible[static_cast<size_t>(found)] ? 1 : 0;
  }
  return {100.0 * wrong / EXAMPLES, 100.0 * infeasible / EXAMPLES};
}

TEST(PaperDefects, TogetherTheyFailInAQuarterToHalfOfAllCases)
{
  struct Expected
  {
    int M;
    double loops_wrong, wrong, infeasible;  // percent
  };
  // The statistical error (three sigma of 40 000) and the rounding of the figures are below 1.3 %.
  for (const Expected& expected : {Expected{1, 50, 50, 0}, Expected{2, 25, 34, 7}, Expected{3, 13, 35, 17},
                                   Expected{5, 22, 41, 23}, Expected{8, 25, 44, 24}, Expected{12, 25, 46, 25}})
  {
    EXPECT_NEAR(sharesOf(expected.M, false).wrong, expected.loops_wrong, 1.3) << expected.M;
    EXPECT_EQ(sharesOf(expected.M, false).infeasible, 0.0) << expected.M;
    EXPECT_NEAR(sharesOf(expected.M, true).wrong, expected.wrong, 1.3) << expected.M;
    EXPECT_NEAR(sharesOf(expected.M, true).infeasible, expected.infeasible, 1.3) << expected.M;
  }
}

}  // namespace
