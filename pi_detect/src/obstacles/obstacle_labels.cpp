#include "obstacles/obstacle_labels.h"

#include <cmath>
#include <optional>

namespace pi_detect::obstacles
{

namespace
{

constexpr double SAME_DEPTH_M = 1.5;  // of the pieces of one labelled object

}  // namespace

std::vector<int> chooseTracks(const std::vector<ObstacleMeasurement>& measurements,
                              const std::vector<ObjectTrack>& tracks, double min_overlap)
{
  std::vector<int> chosen(measurements.size(), -1);
  std::vector<float> best_overlap(measurements.size(), 0.0F);
  for (size_t t = 0; t < tracks.size(); ++t)
  {
    std::optional<size_t> main;
    float largest = 0.0F;
    const auto fits = [&](size_t i)
    {
      const float common = intersection(measurements[i].box, tracks[t].box);
      return common > 0.0F && common >= min_overlap * measurements[i].box.area();
    };
    for (size_t i = 0; i < measurements.size(); ++i)
    {
      const float common = intersection(measurements[i].box, tracks[t].box);
      if (fits(i) && common > largest)
      {
        largest = common;
        main = i;
      }
    }
    for (size_t i = 0; main && i < measurements.size(); ++i)
    {
      const double step = measurements[i].nearest.head<2>().norm() - measurements[*main].nearest.head<2>().norm();
      const float same = overlap(measurements[i].box, tracks[t].box);
      if (fits(i) && std::abs(step) < SAME_DEPTH_M && same > best_overlap[i])
      {
        best_overlap[i] = same;
        chosen[i] = static_cast<int>(t);
      }
    }
  }
  return chosen;
}

}  // namespace pi_detect::obstacles
