#include "engine/offload_engine.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

namespace
{
using pi_offload::EngineOptions;
using pi_offload::NodeAdvertisement;
using pi_offload::NodeDescription;
using pi_offload::OffloadEngine;
using pi_offload::Outcome;
using pi_offload::RequestTiming;
using pi_offload::Task;
using pi_offload::TASK_KINDS;
using pi_offload::TaskKind;
using pi_offload::VehicleState;

constexpr int NODES = 5;
constexpr uint64_t TASKS = 3000;
/// Nothing that is right needs so many calls of onTime() for one task.
constexpr uint64_t MOST_CALLS = 400 * TASKS;

/// Does to an engine what a network, nodes, a vehicle and its users may do to it, in an order that the seed gives.
class RandomDriver
{
public:
  RandomDriver(uint32_t seed, bool throwing) : random_(seed), throwing_(throwing), engine_(options(), actions())
  {
    for (int i = 0; i < NODES; ++i)
    {
      engine_.setNode(description(i), now_);
    }
    moveVehicle();
  }

  void run()
  {
    at(uniform(0.0, 0.1), [this] { submitNext(); });
    at(0.5, [this] { disturb(); });
    at(0.1, [this] { drive(); });
    while (!events_.empty() || engine_.inFlight() > 0)
    {
      ASSERT_LT(calls_, MOST_CALLS) << "the engine is never content: " << engine_.inFlight() << " tasks left, "
                                    << next_task_ << " is next, time " << now_ << " ns, events " << events_.size();
      step();
      if (testing::Test::HasFatalFailure())
      {
        return;
      }
    }
    // What was never answered counts as lost then.
    now_ += seconds(11.0);
    guarded([this] { engine_.onTime(now_); });
    check();
  }

private:
  static int64_t seconds(double s) { return static_cast<int64_t>(s * 1e9); }

  static EngineOptions options()
  {
    EngineOptions options;
    options.max_in_flight = 16;
    options.radio.wait_w = 0.3;
    options.local_lost_s = 20.0;
    return options;
  }

  static std::string name(int node) { return "node_" + std::to_string(node); }

  NodeDescription description(int i)
  {
    NodeDescription d;
    d.id = name(i);
    d.address = "10.0.0." + std::to_string(i + 1) + ":5555";
    d.position = {40.0 * i, 0.0};
    d.range_m = i == 0 ? std::numeric_limits<double>::infinity() : 60.0;
    d.capacity_gcycles = 10.0;
    return d;
  }

  double uniform(double from, double to) { return std::uniform_real_distribution<double>(from, to)(random_); }
  bool chance(double probability) { return uniform(0.0, 1.0) < probability; }
  int any(int count) { return std::uniform_int_distribution<int>(0, count - 1)(random_); }

  void at(double in_s, std::function<void()> event) { events_.emplace(now_ + seconds(in_s), std::move(event)); }

  /// What actions throw must come out of the engine, and nothing else.
  void guarded(const std::function<void()>& function)
  {
    try
    {
      function();
      EXPECT_EQ(thrown_, 0) << "the engine kept an exception to itself";
    }
    catch (const std::runtime_error& e)
    {
      EXPECT_STREQ(e.what(), "action");
      EXPECT_GT(thrown_, 0);
    }
    thrown_ = 0;
  }

  void maybeThrow()
  {
    if (throwing_ && chance(0.01))
    {
      ++thrown_;
      throw std::runtime_error("action");
    }
  }

  NodeAdvertisement advertisement()
  {
    NodeAdvertisement a;
    for (NodeAdvertisement::OfKind& of_kind : a.of_kind)
    {
      of_kind.served = chance(0.97);
      of_kind.service_s = uniform(0.005, 0.05);
      of_kind.queue_s = chance(0.2) ? uniform(0.0, 0.3) : 0.0;
      of_kind.lease_rate_hz = chance(0.5) ? 10.0 : 0.0;
      of_kind.lease_until_s = uniform(0.0, 1.0);
    }
    a.capacity_gcycles = uniform(0.0, 10.0);
    a.draining = chance(0.02);
    return a;
  }

  /// Mostly short, sometimes beyond every deadline.
  double delay() { return chance(0.15) ? uniform(0.1, 3.0) : uniform(0.01, 0.08); }

  void answer(const std::string& node, uint64_t request)
  {
    if (chance(0.1))
    {
      const NodeAdvertisement a = advertisement();
      const bool silent = chance(0.3);
      guarded([&] { engine_.onRefused(node, request, silent ? nullptr : &a, "refused", now_); });
      return;
    }
    RequestTiming timing;
    timing.output_bytes = 1000;
    timing.service_s = uniform(0.005, 0.05);
    timing.queue_s = uniform(0.0, 0.01);
    timing.total_s = timing.service_s + timing.queue_s + uniform(0.0, 0.1);
    guarded([&] { engine_.onReply(node, request, timing, advertisement(), now_); });
  }

  OffloadEngine::Actions actions()
  {
    OffloadEngine::Actions a;
    a.send = [this](const std::string& node, uint64_t request, const Task& task)
    {
      EXPECT_TRUE(under_way_.count(task.id) == 1) << "sent though it has ended: " << task.id;
      maybeThrow();
      if (chance(0.03))
      {
        return false;
      }
      if (!chance(0.05))
      {
        at(delay(), [this, node, request] { answer(node, request); });
      }
      if (chance(0.1))
      {
        at(delay(), [this, node, request] { answer(node, request); });
      }
      return true;
    };
    a.probe = [this](const std::string& node, uint64_t request)
    {
      maybeThrow();
      if (chance(0.03) || (next_task_ > TASKS && engine_.inFlight() == 0))
      {
        return false;  // at the end nobody answers, else it never came
      }
      if (!chance(0.1))
      {
        at(delay(), [this, node, request]
           { guarded([&] { engine_.onProbeReply(node, request, uniform(0.001, 0.1), advertisement(), now_); }); });
      }
      return true;
    };
    a.run_local = [this](const Task& task, double frequency)
    {
      EXPECT_GT(frequency, 0.0);
      EXPECT_TRUE(runs_.insert(task.id).second) << "runs twice on the vehicle: " << task.id;
      maybeThrow();
      const uint64_t id = task.id;
      if (chance(0.05))
      {
        endRun(id);
        return;
      }
      if (chance(0.01))
      {
        return;  // the vehicle forgets it
      }
      const double last_s = chance(0.02) ? uniform(0.2, 2.0) : uniform(0.05, 0.12);
      at(last_s, [this, id] { guarded([&] { endRun(id); }); });
    };
    a.cancel = [this](const std::string&, uint64_t) { maybeThrow(); };
    a.deliver = [this](const Outcome& outcome)
    {
      EXPECT_EQ(under_way_.erase(outcome.task.id), 1U) << "ended twice or never began: " << outcome.task.id;
      EXPECT_EQ(outcome.finished_ns, now_);
      EXPECT_TRUE(std::isfinite(outcome.energy_j) && outcome.energy_j >= 0.0);
      EXPECT_NE(outcome.reason, nullptr);
      count(outcome);
      if (chance(0.05))
      {
        submitOne();
      }
      maybeThrow();
    };
    return a;
  }

  void endRun(uint64_t id)
  {
    if (chance(0.03))
    {
      engine_.onLocalFailed(id, "failed", now_);
    }
    else
    {
      engine_.onLocalDone(id, uniform(0.05, 0.12), now_);
    }
  }

  void count(const Outcome& outcome)
  {
    OffloadEngine::Statistics::OfKind& of_kind = counted_[static_cast<size_t>(outcome.task.kind)];
    of_kind.local += outcome.how == Outcome::How::LOCAL ? 1 : 0;
    of_kind.remote += outcome.how == Outcome::How::REMOTE ? 1 : 0;
    of_kind.fallback += outcome.how == Outcome::How::FALLBACK ? 1 : 0;
    of_kind.abandoned += outcome.how == Outcome::How::ABANDONED ? 1 : 0;
    of_kind.missed += outcome.by_deadline ? 0 : 1;
    of_kind.energy_j += outcome.energy_j;
    const bool in_time = outcome.finished_ns <= outcome.task.created_ns + seconds(outcome.task.deadline_s);
    EXPECT_EQ(outcome.by_deadline, in_time && outcome.how != Outcome::How::ABANDONED);
    EXPECT_EQ(outcome.how == Outcome::How::LOCAL, outcome.node.empty() && outcome.how != Outcome::How::ABANDONED);
  }

  void submitOne()
  {
    if (next_task_ > TASKS)
    {
      return;
    }
    Task task;
    task.id = next_task_++;
    task.kind = chance(0.2) ? TaskKind::SPEECH : TaskKind::DETECTION;
    task.created_ns = now_ - (chance(0.1) ? seconds(uniform(0.0, 0.4)) : 0);
    task.deadline_s = chance(0.3) ? uniform(0.05, 0.6) : 0.0;
    task.input_bytes = static_cast<size_t>(any(100000));
    under_way_.insert(task.id);
    ++counted_[static_cast<size_t>(task.kind)].tasks;
    engine_.submit(task, now_);
  }

  void submitNext()
  {
    if (next_task_ > TASKS)
    {
      return;
    }
    guarded([this] { submitOne(); });
    at(uniform(0.0, 0.15), [this] { submitNext(); });
  }

  void moveVehicle()
  {
    VehicleState state;
    state.known = chance(0.97);
    state.position = {90.0 + 120.0 * std::sin(1e-9 * static_cast<double>(now_) * 0.05), 5.0};
    state.heading = M_PI_2;
    state.speed = chance(0.1) ? 0.0 : 6.0;
    if (chance(0.02))
    {
      state.position.x = std::numeric_limits<double>::quiet_NaN();
    }
    engine_.setVehicle(state);
  }

  void drive()
  {
    moveVehicle();
    if (next_task_ <= TASKS)
    {
      at(0.1, [this] { drive(); });
    }
  }

  /// One of the things that users and the world do.
  void disturb()
  {
    const int node = any(NODES);
    guarded(
        [&]
        {
          switch (any(10))
          {
            case 0:
            case 1:
              engine_.onLinkDown(name(node), now_);
              break;
            case 2:
            case 3:
            case 4:
              engine_.onLinkUp(name(node), now_);
              break;
            case 5:
              engine_.removeNode(name(node), now_);
              at(uniform(0.0, 3.0), [this, node] { engine_.setNode(description(node), now_); });
              break;
            case 6:
              engine_.setEnabled(false, now_);
              at(uniform(0.0, 1.0), [this] { guarded([this] { engine_.setEnabled(true, now_); }); });
              break;
            case 7:
              engine_.setPolicy(pi_offload::policyNames()[static_cast<size_t>(
                  any(static_cast<int>(pi_offload::policyNames().size())))]);
              break;
            case 8:
              engine_.setRoute(chance(0.5) ? std::vector<pi_offload::Point>{}
                                           : std::vector<pi_offload::Point>{{0.0, 0.0}, {100.0, 5.0}, {200.0, 0.0}});
              break;
            default:
              jump_ns_ = seconds(uniform(0.0, 4.0));  // nobody calls for a while
              engine_.onReply(name(node), 1000000 + static_cast<uint64_t>(any(1000)), RequestTiming(), advertisement(),
                              now_);
              break;
          }
        });
    if (next_task_ <= TASKS)
    {
      at(uniform(0.0, 1.0), [this] { disturb(); });
    }
  }

  /// Whatever comes next: an event or the engine's own time.
  void step()
  {
    const int64_t due = engine_.nextTime();
    const int64_t event = events_.empty() ? std::numeric_limits<int64_t>::max() : events_.begin()->first;
    ASSERT_LT(std::min(due, event), std::numeric_limits<int64_t>::max()) << "tasks are left and nothing will happen";
    now_ = std::max(now_, std::min(due, event)) + std::exchange(jump_ns_, 0);
    if (event <= now_)
    {
      const std::function<void()> function = std::move(events_.begin()->second);
      events_.erase(events_.begin());
      function();
      return;
    }
    ++calls_;
    guarded([this] { engine_.onTime(now_); });
    ASSERT_GT(engine_.nextTime(), now_) << "asks to be called again at once";
  }

  void check()
  {
    EXPECT_EQ(next_task_, TASKS + 1);
    EXPECT_TRUE(under_way_.empty());
    EXPECT_EQ(engine_.inFlight(), 0U);
    uint64_t sum_of_remote = 0;
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      const OffloadEngine::Statistics::OfKind& is = engine_.statistics().of_kind[kind];
      const OffloadEngine::Statistics::OfKind& wanted = counted_[kind];
      EXPECT_EQ(is.tasks, wanted.tasks);
      EXPECT_EQ(is.local, wanted.local);
      EXPECT_EQ(is.remote, wanted.remote);
      EXPECT_EQ(is.fallback, wanted.fallback);
      EXPECT_EQ(is.abandoned, wanted.abandoned);
      EXPECT_EQ(is.missed, wanted.missed);
      EXPECT_NEAR(is.energy_j, wanted.energy_j, 1e-6);
      EXPECT_EQ(is.tasks, is.local + is.remote + is.fallback + is.abandoned);
      // The driver has done what it should.
      EXPECT_GT(is.remote, 20U);
      EXPECT_GT(is.local, 20U);
      EXPECT_GT(is.fallback, 20U);
      sum_of_remote += is.remote;
    }
    uint64_t answered = 0;
    for (const OffloadEngine::NodeStatus& node : engine_.nodes(now_))
    {
      EXPECT_EQ(node.sent, node.answered + node.late + node.refused + node.lost) << node.description.id;
      answered += node.answered;
    }
    EXPECT_LE(answered, sum_of_remote);  // nodes that were removed took their counts with them
  }

  std::mt19937 random_;
  bool throwing_;
  int64_t now_ = 0;
  int64_t jump_ns_ = 0;
  int thrown_ = 0;
  uint64_t calls_ = 0;
  uint64_t next_task_ = 1;
  std::multimap<int64_t, std::function<void()>> events_;
  std::set<uint64_t> under_way_;
  std::set<uint64_t> runs_;
  std::array<OffloadEngine::Statistics::OfKind, TASK_KINDS> counted_{};
  OffloadEngine engine_;
};

class OffloadEngineRandom : public testing::TestWithParam<uint32_t>
{
};

TEST_P(OffloadEngineRandom, EveryTaskEndsOnceWhateverHappens)
{
  RandomDriver(GetParam(), false).run();
}

TEST_P(OffloadEngineRandom, EveryTaskEndsOnceThoughActionsThrow)
{
  RandomDriver(GetParam(), true).run();
}

INSTANTIATE_TEST_SUITE_P(Seeds, OffloadEngineRandom, testing::Range(1U, 9U));

}  // namespace
