#pragma once

#include "map/map_data.h"

namespace pi_slam::map
{

struct PoseGraphReport
{
  int iterations = 0;
  double initial_cost = 0.0;
  double final_cost = 0.0;
  bool usable = false;  ///< else nothing was changed
};

/// Moves nodes so that they fit the edges best: position and heading of each, roll and pitch as measured (4 degrees of
/// freedom, as Qin, Li and Shen, TRO 2018, VIII). Loops count robustly (Huber first, so that large corrections get
/// through, then Cauchy). The first node of each connected part stays where it is.
PoseGraphReport optimizePoseGraph(MapData* map);

}  // namespace pi_slam::map
