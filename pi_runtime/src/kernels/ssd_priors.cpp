#include <algorithm>
#include <stdexcept>
#include <string>

#include <pi_runtime/kernels/ssd_postprocess.h>

namespace pi_runtime::kernels
{
namespace
{

SsdPrior clipped(const SsdPrior& prior)
{
  const auto cut = [](float value) { return std::min(std::max(value, 0.0F), 1.0F); };
  const float x1 = cut(prior.cx - prior.width / 2.0F);
  const float x2 = cut(prior.cx + prior.width / 2.0F);
  const float y1 = cut(prior.cy - prior.height / 2.0F);
  const float y2 = cut(prior.cy + prior.height / 2.0F);
  return {(x1 + x2) / 2.0F, (y1 + y2) / 2.0F, x2 - x1, y2 - y1};
}

}  // namespace

std::vector<SsdPrior> makeSsdPriors(const std::vector<SsdFeatureMap>& maps, bool clip)
{
  std::vector<SsdPrior> priors;
  for (size_t index = 0; index < maps.size(); ++index)
  {
    const SsdFeatureMap& map = maps[index];
    if (map.columns <= 0 || map.rows <= 0 || map.boxes.empty())
    {
      throw std::invalid_argument("makeSsdPriors: feature map " + std::to_string(index) + " has " +
                                  std::to_string(map.columns) + " x " + std::to_string(map.rows) + " cells and " +
                                  std::to_string(map.boxes.size()) + " boxes, needs one of each at least");
    }
    const float step_x = map.step_x > 0.0F ? map.step_x : 1.0F / static_cast<float>(map.columns);
    const float step_y = map.step_y > 0.0F ? map.step_y : 1.0F / static_cast<float>(map.rows);
    for (int row = 0; row < map.rows; ++row)
    {
      for (int column = 0; column < map.columns; ++column)
      {
        for (const SsdBoxSize& box : map.boxes)
        {
          const SsdPrior prior{(static_cast<float>(column) + map.offset) * step_x,
                               (static_cast<float>(row) + map.offset) * step_y, box.width, box.height};
          priors.push_back(clip ? clipped(prior) : prior);
        }
      }
    }
  }
  return priors;
}

}  // namespace pi_runtime::kernels
