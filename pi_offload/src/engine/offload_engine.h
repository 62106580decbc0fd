#pragma once

#include "policies/cost_model.h"
#include "policies/estimates.h"
#include "engine/node.h"
#include "policies/policy.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace pi_offload
{

/// A task of the vehicle.
struct Task
{
  uint64_t id = 0;  ///< unique, given by the caller
  TaskKind kind = TaskKind::DETECTION;
  int64_t created_ns = 0;   ///< when its data was there
  double deadline_s = 0.0;  ///< after created_ns, in [0, 3600]; 0: that of its kind by the options
  size_t input_bytes = 0;   ///< as it would be sent
};

/// How a task ended. Each task submitted ends exactly once.
struct Outcome
{
  enum class How
  {
    LOCAL,      ///< decided so
    REMOTE,     ///< decided so, and the node answered
    FALLBACK,   ///< decided for a node, done by the vehicle: no answer in time, refused, or the link broke
    ABANDONED,  ///< neither: the vehicle itself failed or dropped it
  };
  Task task;
  How how = How::LOCAL;
  std::string node;  ///< that it was sent to; empty: none
  int64_t finished_ns = 0;
  bool by_deadline = false;
  double energy_j = 0.0;    ///< by the model: radio, and the vehicle's computer if that was used
  const char* reason = "";  ///< of the decision or of the fallback
};

struct EngineOptions
{
  PolicyOptions policy;
  std::string policy_name = "expected_cost";
  NodeEstimates::Options estimates;
  LocalComputer computer;
  Radio radio;
  double eta = 0.5;
  /// Of each kind of task: work, data volumes (output), deadline; the time on the vehicle until one was measured.
  std::array<TaskNeeds, TASK_KINDS> needs{TaskNeeds{0.19, 0.48, 0.008, 0.2}, TaskNeeds{0.19, 0.512, 0.001, 0.5}};
  double advertisement_valid_s = 1.0;  ///< a node that did not answer for so long is not connected
  double probe_period_s = 0.2;         ///< nodes in range that get no tasks are asked so often
  double probe_period_far_s = 2.0;     ///< nodes out of range, or with a broken link
  int max_failures = 3;        ///< requests in a row without an answer, then it is not connected until a probe is
  size_t max_in_flight = 64;   ///< tasks at nodes; further ones are done by the vehicle
  double local_lost_s = 30.0;  ///< a run on the vehicle that did not end after so long counts as failed

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Where the vehicle is and goes. With a number that is not finite, or a negative speed, it counts as unknown.
struct VehicleState
{
  bool known = false;    ///< false: nodes of finite range are not used
  Point position;        ///< in the map [m]
  double heading = 0.0;  ///< from +Y, clockwise [rad]
  double speed = 0.0;    ///< [m/s]
};

/// Decides, sends, falls back: everything between a task and its one result, without threads, clocks or sockets. The
/// caller passes time in and does what the actions ask for; the simulator and the coordinator both run it.
///
/// Not thread safe. Actions are called from within the methods and may themselves call submit(), onReply(),
/// onRefused(), onLocalDone() and onLocalFailed(), but not destroy the engine. What an action throws comes out of the
/// method once its work is done: of `send` and `probe` it counts as false, of `run_local` as a failure of the vehicle.
/// So a task submitted ends also if submit() threw something that was no std::invalid_argument of its own.
/// Time: of a monotonic clock; an earlier time than the latest one passed counts as that. Jumps forward are allowed.
class OffloadEngine
{
public:
  struct Actions
  {
    /// Sends the task to the node. @param task  with the deadline_s until which the node's answer is wanted.
    /// @return false: the link takes nothing now; the vehicle does it then.
    std::function<bool(const std::string& node, uint64_t request, const Task& task)> send;
    /// Asks the node how it is (an empty request); the answer goes to onProbeReply(). @return as above.
    std::function<bool(const std::string& node, uint64_t request)> probe;
    /// Starts the task on the vehicle; its end goes to onLocalDone() or onLocalFailed(), which may be called within.
    std::function<void(const Task& task, double frequency_ghz)> run_local;
    /// Tells the node that the answer is not wanted any more. May be empty.
    std::function<void(const std::string& node, uint64_t request)> cancel;
    /// The task has ended; its result is the one that came last by onReply() or onLocalDone(), from within which this
    /// is called.
    std::function<void(const Outcome& outcome)> deliver;
  };

  /// @throws std::invalid_argument for options; nothing is called then.
  OffloadEngine(const EngineOptions& options, Actions actions);
  ~OffloadEngine();
  OffloadEngine(const OffloadEngine&) = delete;
  OffloadEngine& operator=(const OffloadEngine&) = delete;

  /// Adds a node, or changes the one with this id; with another address all that was learned of it is forgotten.
  /// @throws std::invalid_argument naming what is wrong.
  void setNode(const NodeDescription& node, int64_t now_ns);
  /// Its tasks under way are done by the vehicle. @return false if there is no such node.
  bool removeNode(const std::string& id, int64_t now_ns);
  void setVehicle(const VehicleState& vehicle);
  /// Planned from now on, in the map; empty: straight on. The vehicle follows it in its order.
  /// @throws std::invalid_argument naming the point that is not finite; the former route stays then.
  void setRoute(const std::vector<Point>& route);
  /// @throws std::invalid_argument naming the name and those that there are.
  void setPolicy(const std::string& name);
  void setPolicyOptions(const PolicyOptions& options);
  /// @param eta  in [0, 1], else std::invalid_argument.
  void setEta(double eta);
  /// The kill switch: while it is off all tasks are the vehicle's; tasks under way are called back.
  void setEnabled(bool enabled, int64_t now_ns);

  /// Decides without doing anything. Allocates nothing. Decision::node is an index into nodes().
  /// @param deadline_s  from now_ns on; 0: that of the kind.
  Decision decide(TaskKind kind, size_t input_bytes, double deadline_s, int64_t now_ns);
  /// Decides and starts; what is returned is what was done. Where the policy gives no time for the fallback, it begins
  /// at deadline - local time * fallback_factor - backlog; if that is over already, the vehicle does it at once.
  /// @throws std::invalid_argument if the id is under way already (the run on the vehicle of a task that a node
  ///   answered counts too), or for a kind or deadline that does not exist.
  Decision submit(const Task& task, int64_t now_ns);

  /// A node's answer to a request. @return true if it is the task's result (the caller keeps the data then until
  /// deliver()); false: late, a duplicate, or unknown; what it says of the node is learned all the same.
  bool onReply(const std::string& node, uint64_t request, const RequestTiming& timing,
               const NodeAdvertisement& advertisement, int64_t now_ns);
  /// The node took the task not, or failed on it: the policy decides once more among the others, and unless it takes
  /// one of them the vehicle does it at once. A node that refuses twice in a row gets no tasks of the kind for 0.1 s,
  /// then for twice as long each time, up to 1.6 s.
  /// @param advertisement, reason  may be null.
  void onRefused(const std::string& node, uint64_t request, const NodeAdvertisement* advertisement, const char* reason,
                 int64_t now_ns);
  void onProbeReply(const std::string& node, uint64_t request, double round_trip_s,
                    const NodeAdvertisement& advertisement, int64_t now_ns);
  /// The connection broke: its tasks are done by the vehicle at once.
  void onLinkDown(const std::string& node, int64_t now_ns);
  void onLinkUp(const std::string& node, int64_t now_ns);
  /// @param work_s  time on the vehicle's processor. @return true if it is the task's result, false if one was there.
  bool onLocalDone(uint64_t task, double work_s, int64_t now_ns);
  /// The task waits for its node until the deadline if that may answer yet, else it is abandoned.
  void onLocalFailed(uint64_t task, const char* reason, int64_t now_ns);

  /// When onTime() wants to be called next; INT64_MAX: never.
  int64_t nextTime() const;
  /// Timeouts, probes.
  void onTime(int64_t now_ns);

  /// Tasks submitted and not ended, at nodes and on the vehicle.
  size_t inFlight() const;
  /// Tasks per second of the kind that the vehicle wants to be sure of at the node: its rate of tasks for the one that
  /// it would use next, 0 for others. For the requests and probes sent there.
  double leaseRate(const std::string& node, TaskKind kind, int64_t now_ns) const;

  struct NodeStatus
  {
    NodeDescription description;
    bool connected = false;
    Residence residence;
    double distance_m = 0.0;
    bool in_range = false;
    double round_trip_s = 0.0;
    double uplink_mbps = 0.0;
    std::array<double, TASK_KINDS> service_s{};
    std::array<double, TASK_KINDS> queue_s{};
    uint64_t sent = 0;      ///< tasks; the sum of those below and of those not known yet
    uint64_t answered = 0;  ///< with what became the result
    uint64_t late = 0;      ///< answered when the task had its result, or was called back
    uint64_t refused = 0;
    uint64_t lost = 0;  ///< never answered: known 10 s after the task's end
  };
  std::vector<NodeStatus> nodes(int64_t now_ns) const;

  struct Statistics
  {
    struct OfKind
    {
      uint64_t tasks = 0;  ///< submitted
      uint64_t local = 0;  ///< ended so, as the next three
      uint64_t remote = 0;
      uint64_t fallback = 0;
      uint64_t abandoned = 0;
      uint64_t missed = 0;     ///< ended after the deadline, or abandoned
      uint64_t handovers = 0;  ///< the node of a task is another one than that of the last task that had one
      double energy_j = 0.0;
    };
    std::array<OfKind, TASK_KINDS> of_kind;
  };
  const Statistics& statistics() const;
  const std::string& lastNode(TaskKind kind) const;  ///< where the last task of the kind went; empty: the vehicle

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
