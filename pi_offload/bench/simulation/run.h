#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <queue>
#include <unordered_map>
#include <vector>

#include "engine/offload_engine.h"
#include "simulation/edge_node.h"
#include "simulation/oracle.h"
#include "simulation/world.h"

namespace pi_offload::simulation
{

constexpr size_t SMALL_MESSAGE_BYTES = 200;  ///< probes, their replies, refusals
constexpr uint64_t PROBE_KEY = 1ULL << 63U;  ///< keeps random keys of probes apart from those of tasks

constexpr double megabits(size_t bytes)
{
  return 8e-6 * static_cast<double>(bytes);
}

/// One run of vehicles and nodes in a world: handles events in the order of their time.
class Run
{
public:
  /// @param policy  of the engine, "oracle" or "informed".
  Run(const World& world, const std::string& policy);
  /// Call this once.
  SimulationResult run();

private:
  struct Event
  {
    enum class Type
    {
      TASK,     ///< id: index
      ENGINE,   ///< call the engine
      ARRIVAL,  ///< of a task at a node; id: ticket
      PROBE_ARRIVAL,
      CANCEL,      ///< reaches the node
      NODE,        ///< call the node
      REPLY,       ///< reaches the vehicle; id: ticket
      LOCAL_DONE,  ///< id: index of the work
      NODE_DOWN,
      NODE_UP,
      LINK_UP,
      FALLBACK,  ///< of the informed policy; id: task
    };
    int64_t at_ns = 0;
    uint64_t serial = 0;  ///< order of events of the same time
    Type type = Type::TASK;
    uint32_t vehicle = 0;
    uint32_t node = 0;
    uint64_t id = 0;
    bool operator>(const Event& other) const
    {
      return at_ns != other.at_ns ? at_ns > other.at_ns : serial > other.serial;
    }
  };
  /// A message to a node.
  struct Request
  {
    enum class State
    {
      UNDER_WAY,
      DONE,
      REFUSED,
      EXPIRED,
    };
    uint32_t vehicle = 0;
    uint32_t node = 0;
    uint64_t request = 0;  ///< the engine's
    bool probe = false;
    Task task;
    int64_t sent_ns = 0;
    int64_t sent_out_ns = std::numeric_limits<int64_t>::max();  ///< end of sending; max: not sent
    Arrival arrival;                                            ///< of a task
    std::array<double, TASK_KINDS> lease_hz{};                  ///< of a probe
    size_t output_bytes = 0;
    double receiving_s = 0.0;
    bool answered = false;
    bool task_ended = false;
    State state = State::UNDER_WAY;
    double queue_s = 0.0;
    double service_s = 0.0;
    NodeAdvertisement advertisement;
  };
  struct Work
  {
    uint32_t vehicle = 0;
    Task task;
    double work_s = 0.0;
  };
  /// A task that has not ended.
  struct Open
  {
    const Task* task = nullptr;
    std::vector<uint64_t> tickets;  ///< of its requests
    bool local = false;             ///< the informed policy's fallback began
  };
  struct Vehicle
  {
    std::string name;
    std::unique_ptr<OffloadEngine> engine;                          ///< null: the oracle
    int64_t engine_event_ns = std::numeric_limits<int64_t>::max();  ///< of the next event ENGINE
    std::vector<bool> link_up;                                      ///< to each node
    int64_t route_set_ns = -1;
    int64_t radio_free_ns = 0;
    std::array<int64_t, TASK_KINDS> processor_free_ns{};
    std::unordered_map<uint64_t, Open> open;
    std::unordered_map<uint64_t, uint64_t> ticket_of;  ///< the engine's requests for tasks
    std::array<int, TASK_KINDS> last_node{-1, -1};     ///< of the oracle
    double local_j = 0.0;
    double fallback_j = 0.0;
    double radio_j = 0.0;
    uint64_t served = 0;
  };

  void push(int64_t at_ns, Event::Type type, size_t vehicle, size_t node, uint64_t id);
  void handle(const Event& event);
  void makeEngine(size_t v, const std::string& policy);
  void updateVehicle(Vehicle* vehicle, size_t v);
  void wakeEngine(size_t v);

  void onTask(size_t v, const Task& task);
  void askOracle(size_t v, const Task& task);
  void askInformed(size_t v, const Task& task, int refused);
  std::vector<double> sampledAnswers(size_t v, size_t node, const Task& task, int64_t sent_ns);
  void onFallback(size_t v, uint64_t id);
  /// Does the task at a node, or on the vehicle (-1), without the engine.
  void place(size_t v, int node, const Task& task);
  /// Energy of the task on the node; nullopt if it would be late.
  std::optional<double> foreseeCost(size_t v, size_t node, const Task& task);
  Arrival arrivalOf(size_t v, size_t node, const Task& task, uint64_t ticket, int64_t arrives_ns) const;
  bool sendTask(size_t v, size_t node, uint64_t request, const Task& task);
  bool sendProbe(size_t v, size_t node, uint64_t request);
  void sendCancel(size_t v, size_t node, uint64_t request);
  void runLocal(size_t v, const Task& task, double frequency_ghz);
  void onOutcome(size_t v, const Outcome& outcome);

  void onArrival(const Event& event);
  void onProbeArrival(const Event& event);
  void onNode(size_t node);
  void handleEnds(size_t node, const std::vector<EdgeNode::End>& ends);
  void sendReply(uint64_t ticket);
  void onReply(uint64_t ticket);
  void onLocalDone(uint64_t id);
  void onNodeDown(size_t node);
  void onNodeUp(size_t node);
  void onLinkUp(size_t v, size_t node);
  void scheduleNode(size_t node);

  size_t nodeIndex(const std::string& id) const { return node_of_.at(id); }
  double leaseRate(size_t v, size_t node, TaskKind kind) const;
  void stopWaiting(const Request& request);
  void forget(uint64_t ticket);
  SimulationResult result();

  const World& world_;
  const Scenario& scenario_;
  const bool informed_;
  std::unordered_map<std::string, size_t> node_of_;
  std::vector<Vehicle> vehicles_;
  std::vector<EdgeNode> nodes_;
  std::vector<std::vector<PendingArrival>> pending_;  ///< per node, on their way
  std::vector<int64_t> node_event_ns_;
  std::vector<bool> down_;                          ///< each node
  std::unordered_map<uint64_t, Request> requests_;  ///< by ticket
  uint64_t last_ticket_ = 0;
  std::unordered_map<uint64_t, Work> works_;
  uint64_t last_work_ = 0;
  std::priority_queue<Event, std::vector<Event>, std::greater<>> events_;
  uint64_t next_serial_ = 0;
  int64_t now_ns_ = 0;
  uint64_t tasks_left_ = 0;
  SimulationResult result_;
  std::array<std::vector<double>, TASK_KINDS> times_s_;
};

}  // namespace pi_offload::simulation
