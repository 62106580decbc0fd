#include "ros/vio_grid.h"

#include <exception>
#include <string>

#include "ros/conversions.h"

namespace pi_slam
{

VioGrid::VioGrid(const VioRosOptions& options, ros::NodeHandle node, VioSession* session,
                 pi_node::WarningBoard* warnings)
  : options_(options), session_(*session), warnings_(*warnings)
{
  if (options_.mapping)
  {
    map_ = node.advertise<nav_msgs::OccupancyGrid>("map", 1, true);
    grid_ = node.subscribe<nav_msgs::OccupancyGrid>(
        "grid", 1, [this](const nav_msgs::OccupancyGridConstPtr& message) { onGrid(*message); });
  }
}

void VioGrid::onGrid(const nav_msgs::OccupancyGrid& message)
{
  const VioPipeline::Ptr pipeline = session_.pipeline();
  if (!pipeline || !pipeline->mapper)
  {
    return;
  }
  try
  {
    if (message.header.frame_id != options_.odom_frame)
    {
      throw std::invalid_argument("frame \"" + message.header.frame_id + "\", must be " + options_.odom_frame +
                                  " (odom_frame)");
    }
    pipeline->mapper->addGrid(fromMsg(message));
    newest_ = message.header.stamp;
  }
  catch (const std::exception& error)
  {
    warnings_.error(grid_.getTopic() + ": " + error.what() + "; left out");
  }
}

void VioGrid::publish()
{
  const VioPipeline::Ptr pipeline = session_.pipeline();
  if (!map_ || map_.getNumSubscribers() == 0 || !pipeline || !pipeline->mapper || newest_ == published_)
  {
    return;
  }
  published_ = newest_;
  if (const std::optional<OccupancyCells> grid = pipeline->mapper->grid())
  {
    map_.publish(toMsg(*grid, newest_, options_.map_frame));
  }
}

}  // namespace pi_slam
