#include "front_end/stereo_tracker_impl.h"

#include <algorithm>

namespace pi_slam
{

namespace
{

using front_end::MovedFeature;
using front_end::Pixel;
using front_end::PointBatch;
using front_end::Step;
using front_end::toPixel;
using front_end::Track;

constexpr double GYRO_SIGMA_RAD_S = 0.1;  ///< of the rate that the prediction is made of, biases unknown
constexpr double LEAST_GYRO_SIGMA_RAD = 0.002;
constexpr double LONGEST_EXTRAPOLATION_S = 0.5;  ///< of the last velocity
constexpr double BACK_TRACKING_PX = 0.3;         ///< how near to its start a feature must come back from pair to pair

double median(std::vector<double>* values)
{
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

}  // namespace

void StereoTracker::Impl::equaliseReference()
{
  for (int c = LEFT; c <= RIGHT; ++c)
  {
    same_places.clear();
    for (size_t i = 0; i < batches[c].size(); ++i)
    {
      same_places.emplace_back(batches[c].to[i], batches[c].from[i]);
    }
    if (!same_places.empty())
    {
      equalise(now[c], reference[c], 1.0);
    }
  }
}

bool StereoTracker::Impl::planStep(size_t index, int camera, const TrackerPrediction& prediction)
{
  const Track& track = tracks[index];
  if (!track.seen.seen[camera] || !track.referenced[camera] || !usable[camera] || !reference_usable[camera])
  {
    return false;
  }
  const Eigen::Isometry3d& T_body_camera = geometry.T_body_camera(camera);
  const Eigen::Vector3d turned = T_body_camera.linear().transpose() *
                                 (R_last_now.conjugate() * (T_body_camera.linear() * track.seen.bearing[camera]));
  const std::optional<Eigen::Vector2d> by_rotation = geometry.camera(camera).project(turned);
  const std::optional<Eigen::Vector3d> p_body =
      prediction.p_body ? prediction.p_body(track.seen.id) : std::optional<Eigen::Vector3d>();
  std::optional<Eigen::Vector2d> predicted;
  if (p_body && p_body->allFinite())
  {
    predicted = geometry.camera(camera).project(T_body_camera.inverse() * *p_body);
  }
  else if (track.has_depth)
  {
    // With the velocity of before. Divided by the distance, so that far points need no special case.
    const Eigen::Vector3d moved =
        turned + track.inverse_distance[camera] * (T_body_camera.linear().transpose() * p_now_last_camera[camera]);
    predicted = geometry.camera(camera).project(moved);
  }
  if (!predicted || !predicted->allFinite() || !inside(toPixel(*predicted), camera, 0.0F))
  {
    predicted = by_rotation;  // what the hint takes out of the picture may still be there
  }
  if (!predicted || !by_rotation || !predicted->allFinite() || !inside(toPixel(*predicted), camera, 0.0F))
  {
    return false;
  }
  steps.push_back({index, camera, batches[camera].size(), toPixel(*by_rotation), Eigen::Vector3d::Zero()});
  batches[camera].add(track.reference[camera], toPixel(*predicted));
  return true;
}

void StereoTracker::Impl::planSteps(const TrackerPrediction& prediction, double dt_s)
{
  const Eigen::Vector3d p_now_last =
      dt_s <= LONGEST_EXTRAPOLATION_S ? Eigen::Vector3d(dt_s * velocity) : Eigen::Vector3d::Zero();
  for (int c = LEFT; c <= RIGHT; ++c)
  {
    const Eigen::Vector3d p_body_camera = geometry.T_body_camera(c).translation();
    p_now_last_camera[c] = R_last_now.conjugate() * p_body_camera + p_now_last - p_body_camera;
  }
  steps.clear();
  for (size_t i = 0; i < tracks.size(); ++i)
  {
    if (!planStep(i, LEFT, prediction))
    {
      planStep(i, RIGHT, prediction);
    }
  }
}

void StereoTracker::Impl::followTracks(const TrackerPrediction& prediction, double dt_s, TrackerReport* report)
{
  batches[LEFT].clear();
  batches[RIGHT].clear();
  planSteps(prediction, dt_s);
  equaliseReference();
  pictures.track({{&reference[LEFT], &now[LEFT], options.levels, &batches[LEFT]},
                  {&reference[RIGHT], &now[RIGHT], options.levels, &batches[RIGHT]}});
  turnRound();
  pictures.track({{&now[LEFT], &reference[LEFT], 1, &back[LEFT]}, {&now[RIGHT], &reference[RIGHT], 1, &back[RIGHT]}});
  size_t kept = 0;
  for (Step& step : steps)
  {
    const PointBatch& batch = batches[step.camera];
    if (!found(batch, step.slot, step.camera) || !cameBack(batch, back[step.camera], step.slot, BACK_TRACKING_PX))
    {
      continue;
    }
    const std::optional<Eigen::Vector3d> bearing = bearingOf(step.camera, batch.to[step.slot]);
    if (bearing)
    {
      step.bearing = *bearing;
      steps[kept++] = step;
    }
  }
  steps.resize(kept);
  const size_t before = tracks.size();
  keepConsistent(prediction, dt_s, report);
  report->tracked = static_cast<int>(tracks.size());
  report->lost = static_cast<int>(before - tracks.size());
}

void StereoTracker::Impl::keepConsistent(const TrackerPrediction& prediction, double dt_s, TrackerReport* report)
{
  std::vector<MovedFeature> moved;
  moved.reserve(steps.size());
  for (const Step& step : steps)
  {
    const Track& track = tracks[step.track];
    moved.push_back({step.camera, track.seen.bearing[step.camera], step.bearing, track.has_depth,
                     track.inverse_distance[step.camera]});
  }
  front_end::BodyMotion motion;
  motion.R_now_last = R_last_now.conjugate().toRotationMatrix();
  std::vector<uint8_t> consistent;
  std::optional<front_end::BodyMotion> expected;
  if (prediction.p_last_now)
  {
    expected = front_end::BodyMotion{motion.R_now_last, -(motion.R_now_last * *prediction.p_last_now)};
  }
  const bool known = motion_check.check(moved, LEAST_GYRO_SIGMA_RAD + GYRO_SIGMA_RAD_S * dt_s, &motion, &consistent,
                                        expected ? &*expected : nullptr);
  report->others_move = motion_check.othersMove();
  velocity = known && dt_s > 0.0 ? Eigen::Vector3d(motion.p_now_last / dt_s) : Eigen::Vector3d::Zero();
  std::vector<double> flow;
  std::vector<double> parallax;
  std::vector<Track> survivors;
  survivors.reserve(static_cast<size_t>(options.max_features));
  for (size_t i = 0; i < steps.size(); ++i)
  {
    const Step& step = steps[i];
    if (consistent[i] == 0)
    {
      continue;
    }
    const Pixel& to = batches[step.camera].to[step.slot];
    Track track = tracks[step.track];
    const Eigen::Vector2f old = track.seen.pixel[step.camera];
    flow.push_back(std::hypot(to.x - old.x(), to.y - old.y()));
    parallax.push_back(std::hypot(to.x - step.by_rotation.x, to.y - step.by_rotation.y));
    for (int c = LEFT; c <= RIGHT && known && track.has_depth; ++c)
    {
      const Eigen::Isometry3d& T_body_camera = geometry.T_body_camera(c);
      const double rho = track.inverse_distance[c];
      if (track.seen.seen[c])
      {
        const Eigen::Vector3d x =
            motion.R_now_last * (T_body_camera.linear() * track.seen.bearing[c] + rho * T_body_camera.translation()) +
            rho * (motion.p_now_last - T_body_camera.translation());
        track.inverse_distance[c] = rho / x.norm();
      }
    }
    track.seen.seen[LEFT] = track.seen.seen[RIGHT] = false;
    track.seen.seen[step.camera] = true;
    track.seen.pixel[step.camera] = Eigen::Vector2f(to.x, to.y);
    track.seen.bearing[step.camera] = step.bearing;
    ++track.seen.age;
    survivors.push_back(track);
  }
  tracks.swap(survivors);
  if (flow.size() >= 5)
  {
    report->flow_px = median(&flow);
    report->parallax_px = median(&parallax);
  }
}

}  // namespace pi_slam
