#include "front_end/stereo_tracker_impl.h"

#include <algorithm>

namespace pi_slam
{

namespace
{

using front_end::BORDER_PX;
using front_end::NEAR_LEVELS;
using front_end::Picture;
using front_end::Pixel;
using front_end::PointBatch;
using front_end::Step;
using front_end::toPixel;
using front_end::Track;

constexpr double BACK_TRACKING_STEREO_PX = 0.7;  ///< and a new stereo match, whose views differ more
constexpr double SAME_MATCH_PX = 2.0;            ///< two ends of a search that are one
constexpr float CLEARLY_BETTER = 0.75F;          ///< residual of the best match over that of the second best
constexpr int LONGEST_DEPTH = 3;                 ///< pairs over which a depth is used without being seen again
constexpr double FARTHEST_BEHIND_PX = 1.0;       ///< disparity below 0 that noise may give to far points

}  // namespace

bool StereoTracker::Impl::acceptMatch(Track* track, int from, const Pixel& pixel)
{
  const int to = 1 - from;
  const std::optional<Eigen::Vector3d> bearing = bearingOf(to, pixel);
  if (!bearing || geometry.epipolarError(from, track->seen.bearing[from], *bearing) > options.epipolar_px)
  {
    return false;
  }
  const double farthest = -FARTHEST_BEHIND_PX / geometry.disparityScale();
  const double rho = geometry.inverseDistance(from, track->seen.bearing[from], *bearing);
  if (rho < farthest || rho * options.min_depth_m > track->seen.bearing[from].z())
  {
    return false;
  }
  track->seen.seen[to] = true;
  track->seen.pixel[to] = Eigen::Vector2f(pixel.x, pixel.y);
  track->seen.bearing[to] = *bearing;
  track->inverse_distance[from] = rho;
  track->inverse_distance[to] = geometry.inverseDistance(to, *bearing, track->seen.bearing[from]);
  track->has_depth = true;
  track->missed = 0;
  return true;
}

/// Makes the right picture as bright as the left one, by the features that both show.
void StereoTracker::Impl::equalisePair()
{
  same_places.clear();
  for (size_t i = 0; i < batches[LEFT].size(); ++i)
  {
    same_places.emplace_back(batches[LEFT].from[i], batches[LEFT].to[i]);
  }
  for (size_t i = 0; i < batches[RIGHT].size(); ++i)
  {
    same_places.emplace_back(batches[RIGHT].to[i], batches[RIGHT].from[i]);
  }
  equalise(now[LEFT], now[RIGHT], mean_ratio);
}

void StereoTracker::Impl::matchKnown()
{
  if (!usable[LEFT] || !usable[RIGHT])
  {
    return;
  }
  batches[LEFT].clear();
  batches[RIGHT].clear();
  steps.clear();
  out_of_sight.assign(tracks.size(), 0);
  for (size_t i = 0; i < tracks.size(); ++i)
  {
    const Track& track = tracks[i];
    const int from = homeOf(track);
    if (!track.has_depth)
    {
      continue;
    }
    const std::optional<Eigen::Vector2d> start = geometry.camera(1 - from).project(
        geometry.transfer(from, track.seen.bearing[from], track.inverse_distance[from]));
    if (!start || !inside(toPixel(*start), 1 - from, BORDER_PX))
    {
      out_of_sight[i] = 1;
    }
    else
    {
      steps.push_back({i, from, batches[from].size(), Pixel{}, Eigen::Vector3d::Zero()});
      batches[from].add(toPixel(track.seen.pixel[from]), toPixel(*start));
    }
  }
  equalisePair();
  const int levels = std::min(NEAR_LEVELS, options.levels);
  pictures.track(
      {{&now[LEFT], &now[RIGHT], levels, &batches[LEFT]}, {&now[RIGHT], &now[LEFT], levels, &batches[RIGHT]}});
  for (const Step& step : steps)
  {
    const PointBatch& batch = batches[step.camera];
    if (found(batch, step.slot, 1 - step.camera))
    {
      acceptMatch(&tracks[step.track], step.camera, batch.to[step.slot]);
    }
  }
  for (size_t i = 0; i < tracks.size(); ++i)
  {
    Track& track = tracks[i];
    if (!(track.seen.seen[LEFT] && track.seen.seen[RIGHT]) && out_of_sight[i] == 0)
    {
      ++track.missed;
      // A wrong depth does not become right by itself.
      track.has_depth = track.has_depth && track.missed < LONGEST_DEPTH;
    }
  }
}

void StereoTracker::Impl::matchUnknown()
{
  if (!usable[LEFT] || !usable[RIGHT])
  {
    return;
  }
  batches[LEFT].clear();
  batches[RIGHT].clear();
  steps.clear();
  const int level = std::min(1, options.levels - 1);
  const Picture views[2] = {pictures.view(now[LEFT], level), pictures.view(now[RIGHT], level)};
  for (size_t i = 0; i < tracks.size(); ++i)
  {
    const Track& track = tracks[i];
    if (track.has_depth)
    {
      continue;
    }
    const int from = homeOf(track);
    const Eigen::Vector2f& pixel = track.seen.pixel[from];
    for (const front_end::CurveSearch::Candidate& candidate :
         search.search(from, views[from], views[1 - from], pixel.cast<double>(), track.seen.bearing[from]))
    {
      steps.push_back({i, from, batches[from].size(), Pixel{}, Eigen::Vector3d::Zero()});
      batches[from].add(toPixel(pixel), candidate.pixel);
    }
  }
  const int levels = std::min(NEAR_LEVELS, options.levels);
  pictures.track(
      {{&now[LEFT], &now[RIGHT], levels, &batches[LEFT]}, {&now[RIGHT], &now[LEFT], levels, &batches[RIGHT]}});
  turnRound();
  pictures.track({{&now[RIGHT], &now[LEFT], 1, &back[LEFT]}, {&now[LEFT], &now[RIGHT], 1, &back[RIGHT]}});
  for (size_t begin = 0, end = 0; begin < steps.size(); begin = end)
  {
    const Step* best = nullptr;
    float best_residual = 0.0F;
    float second_residual = static_cast<float>(options.max_residual) / CLEARLY_BETTER;
    for (end = begin; end < steps.size() && steps[end].track == steps[begin].track; ++end)
    {
      const Step& step = steps[end];
      const PointBatch& there = batches[step.camera];
      const size_t k = step.slot;
      if (!found(there, k, 1 - step.camera) || !cameBack(there, back[step.camera], k, BACK_TRACKING_STEREO_PX))
      {
        continue;
      }
      const bool same = best != nullptr && std::hypot(there.to[k].x - there.to[best->slot].x,
                                                      there.to[k].y - there.to[best->slot].y) < SAME_MATCH_PX;
      if (best == nullptr || there.residual[k] < best_residual)
      {
        second_residual = best == nullptr || same ? second_residual : best_residual;
        best = &step;
        best_residual = there.residual[k];
      }
      else if (!same)
      {
        second_residual = std::min(second_residual, there.residual[k]);
      }
    }
    if (best != nullptr && best_residual <= CLEARLY_BETTER * second_residual)
    {
      acceptMatch(&tracks[best->track], best->camera, batches[best->camera].to[best->slot]);
    }
  }
}

}  // namespace pi_slam
