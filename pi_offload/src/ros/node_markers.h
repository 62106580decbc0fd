#pragma once

#include "engine/offload_engine.h"
#include <ros/time.h>
#include <visualization_msgs/MarkerArray.h>

#include <array>
#include <set>
#include <string>
#include <vector>

namespace pi_offload
{

/// Nodes as rviz shows them: a cylinder, green if the vehicle uses it, blue if it could, orange if it is connected but
/// out of range, grey if it is not connected; a circle for its range, unless that is everywhere; a text "name 4.2 ms,
/// queue 12 ms"; a line from the vehicle to each node in use. Markers of nodes that vanished are deleted. Not thread
/// safe.
class NodeMarkers
{
public:
  explicit NodeMarkers(const std::string& map_frame) : map_frame_(map_frame) {}

  /// @param used  node of the last task of each kind; empty: the vehicle.
  visualization_msgs::MarkerArrayPtr update(const std::vector<OffloadEngine::NodeStatus>& nodes,
                                            const VehicleState& vehicle,
                                            const std::array<std::string, TASK_KINDS>& used, const ros::Time& stamp);

private:
  struct Shown
  {
    std::string group;
    int32_t id = 0;
    bool operator<(const Shown& other) const { return group < other.group || (group == other.group && id < other.id); }
  };

  const std::string map_frame_;
  std::vector<std::string> ids_;  ///< of nodes ever shown: the place is the marker's number
  std::set<Shown> shown_;
};

}  // namespace pi_offload
