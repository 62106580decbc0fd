#pragma once

#include <ros/time.h>
#include <visualization_msgs/MarkerArray.h>

#include <array>
#include <set>
#include <string>
#include <vector>

#include "engine/offload_engine.h"

namespace pi_offload
{

/// Markers of the nodes for rviz. A node is a cylinder: green if the vehicle uses it, blue if the vehicle could, orange
/// if it is connected but out of range, grey if it is not connected. A circle shows a finite range, a text says
/// "name 4.2 ms, queue 12 ms", and a line leads from the vehicle to each node in use. Not thread safe.
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

  void addNode(const OffloadEngine::NodeStatus& node, bool in_use, const VehicleState& vehicle);
  visualization_msgs::Marker& add(const char* group, int32_t id, int32_t type);

  const std::string map_frame_;
  visualization_msgs::MarkerArrayPtr array_;  ///< of the update under way
  ros::Time stamp_;
  std::vector<std::string> ids_;  ///< of nodes ever shown: the place is the marker's number
  std::set<Shown> shown_;         ///< by the last update
};

}  // namespace pi_offload
