#pragma once

#include <pi_slam/LoadMap.h>
#include <pi_slam/SaveMap.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <functional>
#include <memory>
#include <string>

#include "ros/vio_session.h"

namespace pi_slam
{

/// The services ~save_map, ~load_map and ~reset.
class VioServices
{
public:
  /// Calls come on the queue of the handle. The other arguments outlive it.
  VioServices(const VioRosOptions& options, ros::NodeHandle private_node, VioSession* session);

  /// With save_map: writes the map to map_file. Call when no more pictures come, and no calls.
  void saveAtEnd() const;

private:
  bool saveMap(SaveMap::Request& request, SaveMap::Response& response);
  bool loadMap(LoadMap::Request& request, LoadMap::Response& response);
  bool reset(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  /// The mapper, or why there is none.
  void saveCalibration() const;
  std::shared_ptr<Mapper> mapperFor(const std::string& file, std::string* problem) const;
  /// @param work  with the map; its message, unless it throws.
  template <typename Response>
  bool answer(const std::string& file, Response* response, const std::function<std::string(Mapper&)>& work) const;

  const VioRosOptions& options_;
  VioSession& session_;
  ros::ServiceServer save_map_;
  ros::ServiceServer load_map_;
  ros::ServiceServer reset_;
};

}  // namespace pi_slam
