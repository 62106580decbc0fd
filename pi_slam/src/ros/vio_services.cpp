#include "ros/vio_services.h"

#include <exception>

namespace pi_slam
{

VioServices::VioServices(const VioRosOptions& options, ros::NodeHandle private_node, VioSession* session)
  : options_(options)
  , session_(*session)
  , save_map_(private_node.advertiseService("save_map", &VioServices::saveMap, this))
  , load_map_(private_node.advertiseService("load_map", &VioServices::loadMap, this))
  , reset_(private_node.advertiseService("reset", &VioServices::reset, this))
{
}

std::shared_ptr<Mapper> VioServices::mapperFor(const std::string& file, std::string* problem) const
{
  if (file.empty() || file.front() != '/')
  {
    *problem = "file = \"" + file + "\", must be an absolute path: the node's working folder is not the caller's";
    return nullptr;
  }
  if (!options_.mapping)
  {
    *problem = "mapping = false: there is no map";
    return nullptr;
  }
  if (const VioPipeline::Ptr pipeline = session_.pipeline())
  {
    return pipeline->mapper;
  }
  *problem = "there is no map yet: " + session_.problem().text;
  return nullptr;
}

bool VioServices::saveMap(SaveMap::Request& request, SaveMap::Response& response)
{
  const std::shared_ptr<Mapper> mapper = mapperFor(request.file, &response.message);
  if (!mapper)
  {
    return true;
  }
  try
  {
    mapper->flush();
    const MapStatistics statistics = mapper->statistics();
    mapper->save(request.file);
    response.success = true;
    response.message = std::to_string(statistics.keyframes) + " keyframes with " +
                       std::to_string(statistics.landmarks) + " landmarks written to " + request.file;
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

bool VioServices::loadMap(LoadMap::Request& request, LoadMap::Response& response)
{
  const std::shared_ptr<Mapper> mapper = mapperFor(request.file, &response.message);
  if (!mapper)
  {
    return true;
  }
  try
  {
    mapper->load(request.file);
    response.success = true;
    response.message = std::to_string(mapper->statistics().keyframes) + " keyframes read from " + request.file +
                       "; localised as soon as a place is recognised";
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  return true;
}

bool VioServices::reset(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  if (!session_.pipeline())
  {
    response.message = "there is nothing to reset yet: " + session_.problem().text;
    return true;
  }
  session_.restart("~reset: odometry and map begin anew", true);
  response.success = true;
  response.message = "odometry and map begin anew";
  return true;
}

}  // namespace pi_slam
