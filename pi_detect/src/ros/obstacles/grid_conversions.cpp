#include "ros/obstacles/grid_conversions.h"

#include <boost/make_shared.hpp>

namespace pi_detect
{

nav_msgs::OccupancyGridPtr toMsg(const OccupancyGrid& grid, double ground_z, const std_msgs::Header& header)
{
  const auto message = boost::make_shared<nav_msgs::OccupancyGrid>();
  message->header = header;
  message->info.map_load_time = header.stamp;
  message->info.resolution = static_cast<float>(grid.cellSize());
  message->info.width = static_cast<uint32_t>(grid.side());
  message->info.height = static_cast<uint32_t>(grid.side());
  message->info.origin.position.x = grid.origin().x();
  message->info.origin.position.y = grid.origin().y();
  message->info.origin.position.z = ground_z;
  message->info.origin.orientation.w = 1.0;
  message->data = grid.cells();
  return message;
}

}  // namespace pi_detect
