#include "front_end/stereo_tracker_impl.h"

#include <algorithm>

#include <pi_runtime/kernels/corner_grid.h>

namespace pi_slam
{

namespace
{

using front_end::Pixel;
using front_end::toPixel;
using front_end::Track;

constexpr int LEAST_FAST_THRESHOLD = 5;
constexpr int CORNERS_PER_CELL = 2;
constexpr float NEW_BORDER_PX = 8.0F;      ///< and corners nearer to it are not taken
constexpr int MOST_MISSED = 8;             ///< stereo matches that may fail in a row
constexpr double USUAL_STEREO = 0.5;       ///< part of the features; below it, failing says nothing about one of them
constexpr size_t FEW_PART = 20;            ///< of the features; as many may be missing before corners are looked for
constexpr size_t CORNERS_PER_FEATURE = 2;  ///< corners that are tried for each new feature
constexpr double MOST_NEW_SINGLES = 0.3;   ///< part of new features that only one camera sees, if both work

namespace kernels = pi_runtime::kernels;

}  // namespace

void StereoTracker::Impl::addCorners(size_t max_features)
{
  const int camera = usable[LEFT] ? LEFT : RIGHT;
  threshold_falls = false;
  if (!usable[camera] || tracks.size() + max_features / FEW_PART >= max_features)
  {
    return;  // a few missing ones can wait
  }
  const size_t wanted = CORNERS_PER_FEATURE * (max_features - tracks.size());
  int& threshold = fast_threshold[camera];
  pictures.findCorners(now[camera], threshold, &corners);
  // A few corners per feature are needed for a choice; the threshold follows the pictures, one step per pair.
  if (corners.size() < 4 * max_features)
  {
    const int lower = std::max(std::min(LEAST_FAST_THRESHOLD, options.fast_threshold), threshold - 2);
    threshold_falls = lower < threshold;
    threshold = lower;
  }
  else if (corners.size() > 12 * max_features)
  {
    threshold = std::min(options.fast_threshold, threshold + 2);
  }
  corners.erase(
      std::remove_if(
          corners.begin(), corners.end(),
          [this, camera](const kernels::Corner& corner) {
            return !inside(Pixel{static_cast<float>(corner.x), static_cast<float>(corner.y)}, camera, NEW_BORDER_PX);
          }),
      corners.end());
  std::vector<Pixel> existing;
  existing.reserve(tracks.size());
  for (const Track& track : tracks)
  {
    if (track.seen.seen[camera])
    {
      existing.push_back(toPixel(track.seen.pixel[camera]));
    }
  }
  kernels::CornerGrid grid;
  grid.width = geometry.camera(camera).width;
  grid.height = geometry.camera(camera).height;
  grid.cell = options.cell_px;
  grid.per_cell = CORNERS_PER_CELL;
  grid.min_distance = static_cast<float>(options.min_distance_px);
  grid.max_points = existing.size() + wanted;
  for (const kernels::Corner& corner : kernels::selectGridCorners(corners.data(), corners.size(), grid, existing))
  {
    const Pixel pixel{static_cast<float>(corner.x), static_cast<float>(corner.y)};
    const std::optional<Eigen::Vector3d> bearing = bearingOf(camera, pixel);
    if (bearing)
    {
      Track track;
      track.seen.seen[camera] = true;
      track.seen.pixel[camera] = Eigen::Vector2f(pixel.x, pixel.y);
      track.seen.bearing[camera] = *bearing;
      tracks.push_back(track);
    }
  }
}

/// Chooses among the new corners: those that both cameras see go first.
void StereoTracker::Impl::chooseNew(size_t old_count, size_t max_features, TrackerReport* report)
{
  if (tracks.size() <= old_count)
  {
    return;
  }
  const size_t wanted = max_features - old_count;
  const bool both = usable[LEFT] && usable[RIGHT];
  const auto single = [](const Track& track) { return !(track.seen.seen[LEFT] && track.seen.seen[RIGHT]); };
  const auto begin = tracks.begin() + static_cast<std::ptrdiff_t>(old_count);
  const auto singles = std::stable_partition(begin, tracks.end(), [&single](const Track& t) { return !single(t); });
  const auto paired = static_cast<size_t>(singles - begin);
  const auto most_singles = both ? static_cast<size_t>(MOST_NEW_SINGLES * static_cast<double>(wanted)) : wanted;
  const size_t count = std::min({wanted, tracks.size() - old_count, std::min(paired, wanted) + most_singles});
  tracks.resize(old_count + count);
  for (size_t i = old_count; i < tracks.size(); ++i)
  {
    tracks[i].seen.id = next_id++;
  }
  report->created = static_cast<int>(count);
}

/// Removes features that one camera sees where both should: mostly outlines in front of something else.
void StereoTracker::Impl::dropUnpaired()
{
  const auto paired = static_cast<double>(std::count_if(
      tracks.begin(), tracks.end(), [](const Track& t) { return t.seen.seen[LEFT] && t.seen.seen[RIGHT]; }));
  if (paired >= USUAL_STEREO * static_cast<double>(tracks.size()))
  {
    tracks.erase(std::remove_if(tracks.begin(), tracks.end(), [](const Track& t) { return t.missed > MOST_MISSED; }),
                 tracks.end());
  }
}

}  // namespace pi_slam
