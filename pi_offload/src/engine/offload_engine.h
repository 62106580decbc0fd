#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/node.h"
#include "policies/cost_model.h"
#include "policies/estimates.h"
#include "policies/policy.h"

namespace pi_offload
{

/// A task of the vehicle.
struct Task
{
  uint64_t id = 0;  ///< unique, given by the caller
  TaskKind kind = TaskKind::DETECTION;
  int64_t created_ns = 0;   ///< when its data was complete
  double deadline_s = 0.0;  ///< after created_ns, in [0, 3600]; 0: the default of its kind
  size_t input_bytes = 0;   ///< as sent
};

/// How a task ended. Each submitted task ends exactly once.
struct Outcome
{
  enum class How
  {
    LOCAL,      ///< decided for the vehicle
    REMOTE,     ///< decided for a node, which answered
    FALLBACK,   ///< decided for a node, done by the vehicle: no answer in time, refused, or the link broke
    ABANDONED,  ///< no result: the vehicle failed or dropped the task
  };
  Task task;
  How how = How::LOCAL;
  std::string node;     ///< that it was sent to last, or that answered; empty: none
  bool hedged = false;  ///< a second node was asked before the first one answered
  int64_t finished_ns = 0;
  bool by_deadline = false;
  double energy_j = 0.0;    ///< of the radio and, if used, of the vehicle's computer; by the cost model
  const char* reason = "";  ///< of the decision or of the fallback
  double expected_s = 0.0;  ///< after created_ns, when the task was decided; like the next two
  double expected_j = 0.0;
  double expected_misses = 0.0;  ///< probability that the deadline is missed
};

struct EngineOptions
{
  PolicyOptions policy;
  std::string policy_name = "expected_cost";
  NodeEstimates::Options estimates;
  LocalComputer computer;
  Radio radio;
  double eta = 0.5;
  /// By kind: work, data volumes, default deadline. The work gives the time on the vehicle until one is measured.
  std::array<TaskNeeds, TASK_KINDS> needs{TaskNeeds{0.19, 0.48, 0.008, 0.2}, TaskNeeds{0.19, 0.512, 0.001, 0.5}};
  double advertisement_valid_s = 1.0;  ///< without an answer for longer, a node counts as not connected [s]
  double probe_period_s = 0.2;         ///< for nodes in range without tasks [s]
  double probe_period_far_s = 2.0;     ///< for nodes out of range or with a broken link [s]
  int max_failures = 3;                ///< unanswered requests in a row, after which a node must answer a probe first
  size_t max_in_flight = 64;           ///< tasks at nodes; the vehicle does further ones
  double local_lost_s = 30.0;          ///< a longer run on the vehicle counts as failed [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Position and motion of the vehicle. Numbers that are not finite and a negative speed make it unknown.
struct VehicleState
{
  bool known = false;    ///< false: nodes of finite range are not used
  Point position;        ///< in the map [m]
  double heading = 0.0;  ///< from +Y, clockwise [rad]
  double speed = 0.0;    ///< [m/s]
};

/// Brings each task to its one result: decides, sends, and falls back to the vehicle. Has no threads, clocks or
/// sockets: the caller passes the time and performs the actions. Coordinator and simulator both use it.
///
/// Not thread safe. Actions are called from within the methods. They may call submit(), onReply(), onRefused(),
/// onLocalDone() and onLocalFailed(), but must not destroy the engine. An exception of an action leaves the method when
/// its work is done; it counts as false for `send` and `probe`, and as a failure of the vehicle for `run_local`. A task
/// therefore ends even if submit() throws, unless that is submit()'s own std::invalid_argument.
/// All times are of one monotonic clock; a time before the latest one counts as the latest.
class OffloadEngine
{
public:
  struct Actions
  {
    /// Sends the task to the node. Its deadline_s says how long the node's answer is useful.
    /// @return false if the link takes nothing; the vehicle then does the task.
    std::function<bool(const std::string& node, uint64_t request, const Task& task)> send;
    /// Sends an empty request that asks for the node's state; the answer goes to onProbeReply(). @return as `send`.
    std::function<bool(const std::string& node, uint64_t request)> probe;
    /// Starts the task on the vehicle. Its end goes to onLocalDone() or onLocalFailed(), also from within.
    std::function<void(const Task& task, double frequency_ghz)> run_local;
    /// Tells the node that the answer is no longer needed. May be empty.
    std::function<void(const std::string& node, uint64_t request)> cancel;
    /// The task has ended. Called from within the onReply() or onLocalDone() that brought its result.
    std::function<void(const Outcome& outcome)> deliver;
  };

  /// @throws std::invalid_argument for options; nothing is called then.
  OffloadEngine(const EngineOptions& options, Actions actions);
  ~OffloadEngine();
  OffloadEngine(const OffloadEngine&) = delete;
  OffloadEngine& operator=(const OffloadEngine&) = delete;

  /// Adds a node, or changes the one with this id. A new address resets what was learned about it.
  /// @throws std::invalid_argument naming what is wrong.
  void setNode(const NodeDescription& node, int64_t now_ns);
  /// The vehicle does its tasks under way. @return false if there is no such node.
  bool removeNode(const std::string& id, int64_t now_ns);
  /// A node that is not trusted gets no tasks; the vehicle does those under way. Ignores an unknown node.
  void setTrusted(const std::string& id, bool trusted, int64_t now_ns);
  void setVehicle(const VehicleState& vehicle);
  /// The route ahead, in the map; empty: straight on.
  /// @throws std::invalid_argument naming a point that is not finite; the former route is kept.
  void setRoute(const std::vector<Point>& route);
  /// @throws std::invalid_argument naming the known policies.
  void setPolicy(const std::string& name);
  void setPolicyOptions(const PolicyOptions& options);
  /// @param eta  in [0, 1], else std::invalid_argument.
  void setEta(double eta);
  /// The kill switch. While it is off, the vehicle does all tasks; switching off calls back tasks under way.
  void setEnabled(bool enabled, int64_t now_ns);

  /// Decides only. Allocates nothing. Decision::node is an index into nodes().
  /// @param deadline_s  from now_ns; 0: the default of the kind.
  Decision decide(TaskKind kind, size_t input_bytes, double deadline_s, int64_t now_ns);
  /// Decides and starts the task; returns what was done. If the policy gives no time for the fallback, it begins at
  /// deadline - local time * fallback_factor - backlog, or at once if that has passed.
  /// @throws std::invalid_argument for a wrong kind or deadline, or if the id is under way. A run on the vehicle counts
  ///   as under way even after a node answered its task.
  Decision submit(const Task& task, int64_t now_ns);

  /// A node's answer to a request. @return true if it is the task's result; false if it is late, unknown or a
  /// duplicate. The engine learns from it in both cases.
  bool onReply(const std::string& node, uint64_t request, const RequestTiming& timing,
               const NodeAdvertisement& advertisement, int64_t now_ns);
  /// The node refused the task or failed. The policy decides once more without this node; else the vehicle does the
  /// task at once. A node that refuses twice in a row gets no tasks of the kind for 0.1 s, then twice as long each
  /// time, up to 1.6 s.
  /// @param advertisement  may be null.
  void onRefused(const std::string& node, uint64_t request, const NodeAdvertisement* advertisement, int64_t now_ns);
  void onProbeReply(const std::string& node, uint64_t request, double round_trip_s,
                    const NodeAdvertisement& advertisement, int64_t now_ns);
  /// The connection broke: the vehicle does the node's tasks at once.
  void onLinkDown(const std::string& node, int64_t now_ns);
  void onLinkUp(const std::string& node, int64_t now_ns);
  /// The vehicle begins a run that is no task, to check a node's answer: it delays tasks and costs energy. Its end goes
  /// to onLocalDone() or onLocalFailed(). @param run  unique among the ids of tasks.
  void onExtraRun(uint64_t run, TaskKind kind, int64_t now_ns);
  /// @param work_s  time on the vehicle's processor [s]. @return false if the task had a result already.
  bool onLocalDone(uint64_t task, double work_s, int64_t now_ns);
  /// The task waits until its deadline if a node may still answer; else it is abandoned.
  void onLocalFailed(uint64_t task, int64_t now_ns);

  /// When to call onTime(); INT64_MAX: never.
  int64_t nextTime() const;
  /// Handles timeouts and sends probes.
  void onTime(int64_t now_ns);

  /// Submitted tasks that have not ended.
  size_t inFlight() const;
  /// The lease to ask the node for [tasks/s]: the vehicle's rate of tasks for the node that it would use next, 0 for
  /// other nodes.
  double leaseRate(const std::string& node, TaskKind kind, int64_t now_ns) const;

  struct NodeStatus
  {
    NodeDescription description;
    bool connected = false;
    bool trusted = true;
    Residence residence;
    double distance_m = 0.0;
    bool in_range = false;
    double round_trip_s = 0.0;
    double uplink_mbps = 0.0;
    std::array<double, TASK_KINDS> service_s{};
    std::array<double, TASK_KINDS> queue_s{};
    uint64_t sent = 0;      ///< tasks
    uint64_t answered = 0;  ///< with the task's result
    uint64_t late = 0;      ///< answered after the task had ended
    uint64_t refused = 0;
    uint64_t lost = 0;  ///< not answered within 10 s after the task's end
  };
  std::vector<NodeStatus> nodes(int64_t now_ns) const;

  struct Statistics
  {
    struct OfKind
    {
      uint64_t tasks = 0;  ///< submitted
      uint64_t local = 0;  ///< ended so, like the next three
      uint64_t remote = 0;
      uint64_t fallback = 0;
      uint64_t abandoned = 0;
      uint64_t missed = 0;     ///< ended late or abandoned
      uint64_t handovers = 0;  ///< changes of the node between tasks at nodes
      double energy_j = 0.0;   ///< with runs that are no task
    };
    std::array<OfKind, TASK_KINDS> of_kind;
  };
  const Statistics& statistics() const;
  const std::string& lastNode(TaskKind kind) const;  ///< of the last task; empty: the vehicle

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
