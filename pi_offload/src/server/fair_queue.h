#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/node.h"

namespace pi_offload
{

/// A task that a vehicle asks a node for.
struct ServerTask
{
  uint64_t ticket = 0;  ///< unique, given by the caller
  std::string vehicle;  ///< that asks
  TaskKind kind = TaskKind::DETECTION;
  int64_t arrived_ns = 0;
  double remaining_s = 0.0;  ///< from arrived_ns until the answer is useless
};

/// A task that waits.
struct QueuedTask
{
  ServerTask task;
  int64_t deadline_ns = 0;
  bool covered = false;  ///< by a lease; goes first
  bool trial = false;    ///< taken to measure its kind; dropped only after its deadline
  uint64_t serial = 0;   ///< order of arrival, given by add()
};

/// Queue that is fair between vehicles: the vehicle with the least service time is next; its tasks go by deadline.
///
/// A vehicle's service time counts within `window` below and above the common level. A vehicle that was refused goes
/// first, but nobody can save up more than `window`. Not thread safe.
class FairQueue
{
public:
  using Services = std::array<double, TASK_KINDS>;  ///< expected time of a task by kind [s]

  /// @param max_vehicles  remembered without tasks.
  FairQueue(double window_s, size_t max_vehicles) : window_s_(window_s), max_vehicles_(max_vehicles) {}

  void add(QueuedTask task);
  /// Takes out the next task and counts its expected time as served.
  std::optional<QueuedTask> pop(const Services& services);
  /// A task of the vehicle took this much longer than expected; negative: shorter.
  void correct(const std::string& vehicle, bool covered, double more_s);
  std::optional<QueuedTask> remove(uint64_t ticket);
  std::vector<QueuedTask> removeVehicle(const std::string& vehicle);
  /// Removes the tasks for which `unwanted(task)` is true.
  template <typename Unwanted>
  std::vector<QueuedTask> removeIf(const Unwanted& unwanted)
  {
    std::vector<QueuedTask> removed;
    for (Vehicle& vehicle : vehicles_)
    {
      for (Lane& lane : vehicle.lanes)
      {
        for (size_t at = 0; at < lane.tasks.size();)
        {
          if (unwanted(static_cast<const QueuedTask&>(lane.tasks[at])))
          {
            removed.push_back(std::move(lane.tasks[at]));
            lane.tasks.erase(lane.tasks.begin() + static_cast<std::ptrdiff_t>(at));
            --size_;
          }
          else
          {
            ++at;
          }
        }
      }
    }
    return removed;
  }

  size_t size() const { return size_; }
  size_t count(const std::string& vehicle) const;
  /// How far the vehicle is ahead of others in service: -1 to 1, in units of `window`; 0 if it is unknown.
  double ahead(const std::string& vehicle, bool covered) const;
  /// The last task of the vehicle with the most tasks, preferably one without a lease; null if all vehicles have fewer
  /// than `at_least`.
  const QueuedTask* lastOfLongest(size_t at_least) const;

  /// Visits the tasks in the order of pop() without changing the queue.
  /// @param extra  one more task, as the last of its vehicle; may be null.
  /// @param visit  bool visit(const QueuedTask&): whether the task would be served.
  template <typename Visit>
  void plan(const Services& services, const QueuedTask* extra, const Visit& visit) const
  {
    Plan plan = startPlan(extra);
    while (const QueuedTask* task = nextOf(&plan))
    {
      advance(&plan, services, visit(*task));
    }
  }

private:
  /// 0: covered by leases, 1: others.
  static constexpr size_t LANES = 2;
  struct Lane
  {
    double served_s = 0.0;          ///< on the lane's clock
    std::vector<QueuedTask> tasks;  ///< by deadline
  };
  struct Vehicle
  {
    std::string name;
    std::array<Lane, LANES> lanes;
    size_t count() const { return lanes[0].tasks.size() + lanes[1].tasks.size(); }
  };
  struct Plan
  {
    struct Entry
    {
      double served_s = 0.0;
      std::vector<const QueuedTask*> tasks;
      size_t next = 0;
    };
    std::array<std::vector<Entry>, LANES> lanes;
    std::array<double, LANES> clock_s{};
    size_t lane = LANES;
    Entry* entry = nullptr;
    double start_s = 0.0;
  };

  static size_t laneOf(bool covered) { return covered ? 0 : 1; }
  Vehicle* find(const std::string& name);
  const Vehicle* find(const std::string& name) const;
  Vehicle& findOrAdd(const std::string& name);
  double startTime(double served_s, double clock_s) const;
  Plan startPlan(const QueuedTask* extra) const;
  const QueuedTask* nextOf(Plan* plan) const;
  static void advance(Plan* plan, const Services& services, bool served);

  double window_s_;
  size_t max_vehicles_;
  std::vector<Vehicle> vehicles_;
  std::array<double, LANES> clock_s_{};
  size_t size_ = 0;
  uint64_t next_serial_ = 0;
};

}  // namespace pi_offload
