#pragma once

#include "policies/admission.h"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_offload
{

/// A task that waits.
struct QueuedTask
{
  ServerTask task;
  int64_t deadline_ns = 0;
  bool covered = false;  ///< by a lease: these go first
  bool trial = false;    ///< taken to measure the kind again: dropped only when its deadline has passed
  uint64_t serial = 0;   ///< order of arrival, given by add()
};

/// Tasks of vehicles in fair order: the vehicle that has had the least service time is next, the tasks of one vehicle
/// go by deadline. What a vehicle has had counts from `window` before the present level to `window` above it: who was
/// refused goes before who was served, but nobody saves up. Not thread safe.
class FairQueue
{
public:
  using Services = std::array<double, TASK_KINDS>;  ///< what a task is expected to take [s]

  /// @param window_s      see above.
  /// @param max_vehicles  that are remembered while they have no tasks.
  FairQueue(double window_s, size_t max_vehicles) : window_s_(window_s), max_vehicles_(max_vehicles) {}

  void add(QueuedTask task);
  /// The next one, which is counted as served with what its kind is expected to take.
  std::optional<QueuedTask> pop(const Services& services);
  /// A task of the vehicle took so much more than expected (or less, if negative).
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
  /// How much more service than others the vehicle has had, from -1 to 1 (`window`); 0 for an unknown one.
  double ahead(const std::string& vehicle, bool covered) const;
  /// The last task of the vehicle with the most tasks, those without a lease first; null if all have fewer than
  /// `at_least`.
  const QueuedTask* lastOfLongest(size_t at_least) const;
  /// Calls `visit(name)` for each vehicle with tasks.
  template <typename Visit>
  void forEachVehicle(const Visit& visit) const
  {
    for (const Vehicle& vehicle : vehicles_)
    {
      if (vehicle.count() != 0)
      {
        visit(vehicle.name);
      }
    }
  }

  /// Goes through the tasks in the order in which pop() would give them, without changing anything.
  /// @param extra  a task that is thought of as the last of its vehicle; may be null.
  /// @param visit  bool visit(const QueuedTask&): whether it would be served then.
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
