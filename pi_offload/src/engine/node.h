#pragma once

#include "policies/residence.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace pi_offload
{

/// What can be offloaded. SLAM cannot: it is asked every 5 ms.
enum class TaskKind : uint8_t
{
  DETECTION = 0,
  SPEECH = 1,
};
constexpr size_t TASK_KINDS = 2;
const char* toString(TaskKind kind);
/// @throws std::invalid_argument naming the text and what is allowed.
TaskKind parseTaskKind(const std::string& text);

/// What is configured or announced of an edge-cloud node.
struct NodeDescription
{
  std::string id;                 ///< unique, 1 to 64 letters, digits, '_', '-', '.'
  std::string address;            ///< host:port; empty: none, as in simulation
  Point position;                 ///< in the map [m]
  double range_m = 0.0;           ///< within which its network is used; infinite: everywhere
  double frequency_ghz = 10.0;    ///< f_off: how fast a task runs there, for policies of the paper
  double capacity_gcycles = 0.0;  ///< w_i of the paper: what it can take besides; it is advertised later

  /// @throws std::invalid_argument naming node, field, value and bound.
  void validate() const;
};

/// What a node says of itself, in each reply.
struct NodeAdvertisement
{
  struct OfKind
  {
    bool served = false;
    double service_s = 0.0;            ///< mean time of a task on a worker [s]
    double service_deviation_s = 0.0;  ///< mean deviation
    double queue_s = 0.0;              ///< until a worker is free for a task of this vehicle that comes now [s]
    double lease_until_s = 0.0;        ///< the vehicle's lease holds so long yet [s]; 0: none
    double lease_rate_hz = 0.0;        ///< tasks per second that it is for
  };
  std::array<OfKind, TASK_KINDS> of_kind;
  double capacity_gcycles = 0.0;  ///< free per second
  bool draining = false;          ///< takes no new tasks
  bool has_position = false;
  Point position;
  double range_m = 0.0;
};

}  // namespace pi_offload
