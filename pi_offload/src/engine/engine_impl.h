#pragma once

#include <pi_node/durations.h>

#include <cstdint>
#include <deque>
#include <exception>
#include <limits>
#include <set>
#include <unordered_map>
#include <utility>

#include "engine/local_model.h"
#include "engine/offload_engine.h"
#include "engine/route_tracker.h"

namespace pi_offload
{

constexpr int64_t LONG_AGO_NS = std::numeric_limits<int64_t>::min();
constexpr int64_t NEVER_NS = std::numeric_limits<int64_t>::max();

/// Instants of tasks, the next one first.
using TaskTimes = std::set<std::pair<int64_t, uint64_t>>;

/// Duration in nanoseconds, cut at 95 years so that sums with instants stay in range.
inline int64_t toNs(double seconds)
{
  constexpr double MOST_S = 3e9;
  return seconds >= MOST_S ? static_cast<int64_t>(MOST_S * 1e9) : static_cast<int64_t>(seconds * 1e9);
}

/// instant + duration, cut below NEVER_NS.
inline int64_t later(int64_t instant_ns, int64_t duration_ns)
{
  int64_t sum = 0;
  const bool beyond = __builtin_add_overflow(instant_ns, duration_ns, &sum);
  return !beyond ? sum : duration_ns > 0 ? NEVER_NS - 1 : LONG_AGO_NS;
}

/// Difference [s], also of instants far apart.
inline double between(int64_t from_ns, int64_t to_ns)
{
  int64_t difference = 0;
  const bool beyond = __builtin_sub_overflow(to_ns, from_ns, &difference);
  return beyond ? pi_node::seconds(to_ns) - pi_node::seconds(from_ns) : pi_node::seconds(difference);
}

/// What the engine knows about a node.
struct NodeState
{
  NodeState(const NodeEstimates::Options& options, const std::array<AnswerTimes, TASK_KINDS>& times)
    : estimates(options), of_kind{OfKind(&times[0]), OfKind(&times[1])}
  {
  }

  uint64_t key = 0;  ///< unique for ever, unlike the id
  size_t index = 0;  ///< in Impl::nodes
  NodeDescription description;
  NodeEstimates estimates;

  bool link_up = true;
  bool trusted = true;
  bool suspended = false;  ///< too many unanswered requests; until a probe is answered
  int failures = 0;        ///< unanswered requests in a row

  uint64_t probe = 0;  ///< under way; 0: none
  bool probe_soon = true;
  int64_t probed_ns = LONG_AGO_NS;
  int64_t heard_ns = LONG_AGO_NS;

  double distance_m = std::numeric_limits<double>::infinity();
  bool in_range = false;
  bool placed = false;  ///< residence was computed since it came into range
  bool old = false;     ///< the vehicle's state is newer than the residence
  bool moved = false;   ///< and the vehicle moved far, or not as expected
  int64_t placed_ns = 0;
  Residence residence;  ///< at placed_ns

  /// A task of this vehicle that the node has not answered.
  struct Own
  {
    uint64_t request = 0;
    TaskKind kind = TaskKind::DETECTION;
    int64_t sent_ns = 0;
  };
  std::vector<Own> own;
  double own_share = 0.3;  ///< part of these tasks' service time that the next task waits; smaller with more workers

  struct OfKind
  {
    explicit OfKind(const AnswerTimes* usual) : times(usual) {}

    AnswerTimes times;
    double lost_j = 0.0;  ///< that tasks here cost more than on the vehicle, lately; negative: less
    int rests = 0;        ///< in a row
    int64_t rests_until_ns = LONG_AGO_NS;
    MeanDeviation said_queue_s;  ///< as advertised: the usual queue
    double queue_error_s = 0.0;  ///< mean error of the forecast
    int64_t served_ns = LONG_AGO_NS;
    double tokens = 2.0;  ///< tasks that the lease covers at tokens_ns
    int64_t tokens_ns = 0;
    int refusals = 0;            ///< in a row
    double refused_share = 0.0;  ///< of the answers, at answered_ns
    int64_t answered_ns = LONG_AGO_NS;
    int64_t refused_until_ns = LONG_AGO_NS;
  };
  std::array<OfKind, TASK_KINDS> of_kind;

  uint64_t sent = 0;
  uint64_t answered = 0;
  uint64_t late = 0;
  uint64_t refused = 0;
  uint64_t lost = 0;
};

/// The expected queue and its parts.
struct QueueForecast
{
  double advertised_s = 0.0;
  double own_s = 0.0;  ///< service time of own tasks sent after the advertisement
  Estimate estimate;
};

struct OffloadEngine::Impl
{
  Impl(const EngineOptions& options, Actions actions);

  // --- Nodes (engine_nodes.cpp) ---------------------------------------------------------------------------------
  void setNode(const NodeDescription& description);
  bool removeNode(const std::string& id);
  NodeState* find(const std::string& id) const;
  NodeState* find(uint64_t key) const;
  void setVehicle(const VehicleState& state);
  void setRoute(const std::vector<Point>& points);
  /// Computes the distance and whether the node is in range.
  void measure(NodeState& node);
  /// Computes missing residences of nodes in range, and renews at most so many old ones.
  void placeNodes(size_t renewals);
  void place(NodeState& node);
  Residence residenceIn(const NodeDescription& node, bool whole_route) const;
  double residence(const NodeState& node) const;
  bool connected(const NodeState& node, TaskKind kind) const;
  /// @param ahead_s  time until the task arrives [s]
  QueueForecast queue(const NodeState& node, TaskKind kind, double ahead_s) const;
  /// Expected time from sending to the arrival at the node [s].
  double uplinkTime(const NodeState& node, TaskKind kind) const;
  Estimate service(const NodeState& node, TaskKind kind) const;
  double uplinkBacklog() const;
  double refusedShare(const NodeState::OfKind& of_kind) const;
  void countRefused(NodeState::OfKind& of_kind, bool refused) const;
  double tokens(const NodeState& node, TaskKind kind) const;
  void fillView(NodeState& node, TaskKind kind, double input_mbit, double output_mbit, NodeView& view) const;
  void heard(NodeState& node, const NodeAdvertisement& advertisement);
  int64_t probeDue(const NodeState& node) const;
  void sendProbes();
  void onProbeReply(const std::string& node, uint64_t request, double round_trip_s,
                    const NodeAdvertisement& advertisement);
  NodeStatus status(const NodeState& node) const;
  const NodeState* quickestNode(TaskKind kind) const;
  double leaseRate(const std::string& id, TaskKind kind) const;

  // --- Tasks (engine_tasks.cpp, engine_answers.cpp) -------------------------------------------------------------
  /// A request for a task that is neither answered nor lost.
  struct Request
  {
    uint64_t task = 0;
    uint64_t node = 0;  ///< key
    TaskKind kind = TaskKind::DETECTION;
    size_t bytes = 0;
    int64_t sent_ns = 0;
    double expected_queue_s = 0.0;  ///< without own tasks
    double expected_own_s = 0.0;
    Estimate answer_s;       ///< as expected
    double rate_mbps = 0.0;  ///< when it was sent
    bool open = true;        ///< an answer would be the task's result
    bool counted = false;    ///< in AnswerTimes
  };
  struct TaskState
  {
    Task task;
    int64_t deadline_ns = 0;
    std::array<uint64_t, 2> requests{};  ///< the last one, and that of a hedge; 0: none
    std::string node;                    ///< of the last request
    uint64_t first_node = 0;             ///< key of the node that it was decided for; 0: the vehicle
    bool local = false;                  ///< runs on the vehicle
    bool local_failed = false;
    double local_ghz = 0.0;  ///< 0: it did not run on the vehicle
    bool retried = false;
    bool hedged = false;
    int64_t sent_ns = 0;
    double radio_j = 0.0;  ///< of ended requests
    int64_t timer_ns = NEVER_NS;
    int64_t latest_ns = NEVER_NS;  ///< a fallback that begins later misses the deadline
    int64_t hedge_ns = NEVER_NS;
    const char* reason = "";
    double expected_s = 0.0;  ///< after created_ns
    double expected_j = 0.0;
    double expected_misses = 0.0;
  };

  /// @param refused  index of a node that is excluded, or -1.
  Decision decide(TaskKind kind, size_t bytes, double remaining_s, int refused);
  void fillInput(TaskKind kind, size_t bytes, double remaining_s, int refused, bool remote, DecisionInput* in);
  /// When the vehicle begins the task itself.
  int64_t fallbackTime(const Decision& decision, const Task& task, int64_t deadline_ns) const;
  Decision submit(const Task& task);
  void checkTask(const Task& task) const;
  void keepLocal(Decision* decision, const TaskState& state, const char* reason) const;
  void expect(TaskState* state, const Decision& decision) const;
  uint64_t openRequest(NodeState& node, const Task& task);
  /// @return false if the link took nothing.
  bool sendTo(uint64_t id, const Decision& decision, int64_t fallback_ns);
  /// After the task's creation; a later answer is of little use [s].
  double usefulUntil(const TaskState& state) const;
  void startLocal(uint64_t id, double frequency_ghz, const char* reason);
  /// Starts fallbacks that are nearly due and would be late behind a run of this task.
  void startOverdue(uint64_t id, double frequency_ghz);
  double localNeed(TaskKind kind) const;
  void localFailed(uint64_t id, const char* reason);
  void setTimer(TaskState& state, int64_t at_ns);
  void setHedge(TaskState& state, int64_t at_ns);
  void onTimer(uint64_t id);
  /// The answer is late: asks another node too if that pays and the budget allows.
  void hedge(uint64_t id);
  /// Stops waiting for the answer and adds the request's energy.
  void closeRequest(TaskState& state, uint64_t request, bool tell_node);
  void closeRequests(TaskState& state, bool tell_node);
  /// The open request of the task at the node; 0: none. @param node  key; 0: any
  uint64_t openAt(const TaskState& state, uint64_t node) const;
  void countAnswer(NodeState& node, Request* request);
  /// The gain or loss of a task against the vehicle, on its node's account.
  void account(const TaskState& state, const Outcome& outcome);
  void forgetOwn(NodeState& node, uint64_t request);
  double unansweredEnergy(const Request& request) const;
  bool answerable(const TaskState& state) const;
  void finish(uint64_t id, Outcome::How how);
  void fallBackAll(uint64_t node, const char* reason, bool answerable, bool tell_node);
  RequestTiming learn(NodeState& node, const Request& request, const RequestTiming& timing);
  double answeredEnergy(const NodeState& node, const Request& request, size_t output_bytes) const;
  bool onReply(const std::string& node, uint64_t request, const RequestTiming& timing,
               const NodeAdvertisement& advertisement);
  void onRefused(const std::string& node, uint64_t request, const NodeAdvertisement* advertisement);
  bool sendElsewhere(TaskState& state, int refused);
  bool onLocalDone(uint64_t id, double work_s);
  void setEnabled(bool on);
  void onTime();
  void forgetOld();
  int64_t nextTime() const;

  void setTime(int64_t now_ns) { now = std::max(now, now_ns); }
  /// Calls an action and keeps its exception for raise().
  template <typename Function>
  void call(const Function& function)
  {
    try
    {
      function();
    }
    catch (...)
    {
      if (!error)
      {
        error = std::current_exception();
      }
    }
  }
  /// Throws the exception kept by call(). Ends each public method that calls actions.
  void raise()
  {
    if (error)
    {
      std::rethrow_exception(std::exchange(error, nullptr));
    }
  }

  EngineOptions options;
  Actions actions;
  std::unique_ptr<Policy> policy;
  bool enabled = true;
  int64_t now = LONG_AGO_NS;
  std::exception_ptr error;

  std::vector<std::unique_ptr<NodeState>> nodes;
  std::unordered_map<std::string, NodeState*> nodes_by_id;
  std::unordered_map<uint64_t, NodeState*> nodes_by_key;
  uint64_t last_key = 0;
  VehicleState vehicle;
  RouteTracker route;
  size_t next_renewal = 0;
  std::vector<uint64_t> due;  ///< scratch of sendProbes()

  DecisionInput input;        ///< views in the order of `nodes`
  DecisionInput local_input;  ///< without nodes

  LocalModel local;
  std::unordered_map<uint64_t, TaskState> tasks;
  std::unordered_map<uint64_t, Request> requests;
  size_t open_requests = 0;
  std::deque<std::pair<int64_t, uint64_t>> closed;  ///< time of loss, request
  TaskTimes timers;
  TaskTimes hedges;
  double hedge_budget_j = 0.0;
  std::array<AnswerTimes, TASK_KINDS> times;  ///< of all nodes
  uint64_t last_request = 0;
  int64_t uplink_until_ns = LONG_AGO_NS;  ///< expected end of sending
  int64_t uplink_seen_ns = LONG_AGO_NS;   ///< sending had ended then, as answers show
  int64_t tidied_ns = LONG_AGO_NS;

  struct Last
  {
    uint64_t node = 0;  ///< key; 0: the vehicle
    std::string name;
    uint64_t node_before = 0;  ///< of the last task at a node
    int64_t submitted_ns = LONG_AGO_NS;
    MeanDeviation interval_s;
  };
  std::array<Last, TASK_KINDS> last;
  Statistics statistics;
};

}  // namespace pi_offload
