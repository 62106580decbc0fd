#pragma once

#include <nav_msgs/OccupancyGrid.h>
#include <std_msgs/Header.h>

#include "obstacles/occupancy_grid.h"

namespace pi_detect
{

/// @param ground_z  height of the cells in the header's frame [m].
nav_msgs::OccupancyGridPtr toMsg(const OccupancyGrid& grid, double ground_z, const std_msgs::Header& header);

}  // namespace pi_detect
