#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "policies/residence.h"

namespace pi_offload
{

/// Kinds of tasks that can be offloaded. SLAM cannot: the vehicle needs it every 5 ms.
enum class TaskKind : uint8_t
{
  DETECTION = 0,
  SPEECH = 1,
};
constexpr size_t TASK_KINDS = 2;
const char* toString(TaskKind kind);
/// @throws std::invalid_argument naming the text and what is allowed.
TaskKind parseTaskKind(const std::string& text);

/// An edge-cloud node as it is configured or announced.
struct NodeDescription
{
  std::string id;                 ///< unique, 1 to 64 letters, digits, '_', '-', '.'
  std::string address;            ///< host:port; empty: none, as in simulation
  Point position;                 ///< in the map [m]
  double range_m = 0.0;           ///< of its network; infinite: everywhere [m]
  double frequency_ghz = 10.0;    ///< f_off of the paper: clock of a worker
  double capacity_gcycles = 0.0;  ///< w_i of the paper: free cycles, until the node advertises them
  std::string network{};          ///< of its detector, as announced; empty: not told

  /// @throws std::invalid_argument naming node, field, value and bound.
  void validate() const;
};

/// The state of a node, sent with each reply.
struct NodeAdvertisement
{
  struct OfKind
  {
    bool served = false;
    double service_s = 0.0;            ///< mean time of a task on a worker [s]
    double service_deviation_s = 0.0;  ///< mean deviation
    double queue_s = 0.0;              ///< wait of a task that arrives now from this vehicle [s]
    double lease_until_s = 0.0;        ///< remaining time of the vehicle's lease [s]; 0: no lease
    double lease_rate_hz = 0.0;        ///< tasks per second that the lease covers
  };
  std::array<OfKind, TASK_KINDS> of_kind;
  double capacity_gcycles = 0.0;  ///< free cycles per second [10^9]
  bool draining = false;          ///< takes no new tasks
  bool has_position = false;
  Point position;
  double range_m = 0.0;
};

}  // namespace pi_offload
