#include "map/packed_cells.h"

#include <opencv2/imgcodecs.hpp>

namespace pi_slam::map
{

PackedCells::PackedCells(const OccupancyCells& grid) : frame_{grid.origin, grid.cell_m, grid.width, grid.height, {}}
{
  if (!grid.cells.empty())
  {
    std::vector<int8_t> cells = grid.cells;  // cv::Mat takes no const data
    cv::imencode(".png", cv::Mat(grid.height, grid.width, CV_8UC1, cells.data()), packed_);
    packed_.shrink_to_fit();
  }
}

OccupancyCells PackedCells::unpack() const
{
  OccupancyCells grid = frame_;
  if (!packed_.empty())
  {
    const cv::Mat picture = cv::imdecode(packed_, cv::IMREAD_GRAYSCALE);
    grid.cells.assign(picture.datastart, picture.dataend);
  }
  return grid;
}

}  // namespace pi_slam::map
