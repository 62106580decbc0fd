#pragma once

#include "engine/node.h"

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace pi_offload_bench
{

struct FleetOptions
{
  size_t vehicles = 1;
  std::vector<std::string> servers;  ///< host:port
  /// false: each task is sent, to the server with the shorter queue, and one that is refused to the other one if that
  /// may be in time yet. true: an OffloadEngine decides, with its probes, leases, timeouts and local fallback.
  bool engine = false;
  std::array<double, pi_offload::TASK_KINDS> rate_hz{10.0, 0.0};
  std::array<double, pi_offload::TASK_KINDS> deadline_s{0.2, 0.5};
  double local_s = 0.09;  ///< that a task takes on the vehicle, one after the other
  double warm_up_s = 5.0;
  double measured_s = 60.0;
  uint32_t seed = 1;
};

/// What is sent.
struct FleetInputs
{
  std::vector<std::vector<uint8_t>> pictures;  ///< JPEG, in turn
  std::vector<uint8_t> sound;                  ///< S16LE
};

/// How the tasks of a kind ended that were there between the end of the warm-up and the end. The first group adds up
/// to `tasks`.
struct FleetTally
{
  uint64_t tasks = 0;
  uint64_t in_time = 0;     ///< answered by a server
  uint64_t refused = 0;     ///< by all servers that were asked, at once
  uint64_t given_back = 0;  ///< taken, then refused as another vehicle's turn came before
  uint64_t kept = 0;        ///< the engine did not ask a server
  uint64_t late = 0;        ///< answered after the deadline, or not, or the vehicle gave up waiting: timeouts
  uint64_t failed = 0;      ///< no connection, or an error

  uint64_t missed = 0;                  ///< with an engine: ended after the deadline, wherever
  std::vector<double> answer_s;         ///< of those in time: from the picture to its answer
  std::vector<double> refusal_s;        ///< of those refused: until the vehicle knew
  std::vector<double> given_back_s;     ///< the same of those given back
  std::vector<uint64_t> served;         ///< in time, by vehicle
  std::vector<double> longest_pause_s;  ///< between answers in time, by vehicle
};

class Vehicle;

/// Simulated vehicles: real connections, no computing. Begins at once.
class Fleet
{
public:
  Fleet(const FleetOptions& options, const FleetInputs& inputs);
  ~Fleet();
  Fleet(const Fleet&) = delete;
  Fleet& operator=(const Fleet&) = delete;

  void waitForBegin() const;  ///< of what is measured
  void waitForEnd() const;
  /// Ends it when all tasks have ended.
  std::array<FleetTally, pi_offload::TASK_KINDS> finish();

private:
  void drive();

  const FleetOptions options_;
  const FleetInputs& inputs_;
  int64_t begin_ns_ = 0;
  int64_t end_ns_ = 0;
  std::vector<std::unique_ptr<Vehicle>> vehicles_;
  std::atomic<bool> stop_{false};
  std::thread driver_;
};

}  // namespace pi_offload_bench
