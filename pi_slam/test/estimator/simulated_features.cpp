#include "estimator/simulated_features.h"

#include <algorithm>
#include <cmath>

using namespace pi_slam;

SimulatedFeatures::SimulatedFeatures(const SplineTrajectory& trajectory, const StereoCalibration& calibration,
                                     const SimulatedFeaturesOptions& options)
  : trajectory_(trajectory), calibration_(calibration), options_(options), random_(options.seed)
{
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const double duration_s = 1e-9 * static_cast<double>(trajectory_.endNs() - trajectory_.startNs());
  const auto direction = [&]
  { return Eigen::Vector3d{normal(random_), normal(random_), normal(random_)}.normalized().eval(); };
  for (int i = 0; i < options_.landmarks; ++i)
  {
    Landmark landmark;
    const double range = options_.min_range + uniform(random_) * (options_.max_range - options_.min_range);
    const double time_s = uniform(random_) * duration_s;
    landmark.p_world = trajectory_.atSeconds(time_s).T_world_body.translation() + range * direction();
    landmark.outlier = uniform(random_) < options_.outlier_ratio;
    if (landmark.outlier && uniform(random_) < 0.5)
    {
      const double speed = 0.5 + uniform(random_);
      landmark.v_world = speed * direction();
    }
    else if (landmark.outlier)
    {
      const double angle = 2.0 * M_PI * uniform(random_);
      landmark.mismatch = (5.0 + 35.0 * uniform(random_)) * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    }
    landmarks_.push_back(landmark);
  }
}

FrameFeatures SimulatedFeatures::at(int64_t stamp_ns)
{
  const Eigen::Isometry3d T_world_body = trajectory_.at(stamp_ns).T_world_body;
  const double time_s = 1e-9 * static_cast<double>(stamp_ns - trajectory_.startNs());
  const MountedCamera* cameras[2] = {&calibration_.left, &calibration_.right};
  const Eigen::Isometry3d T_camera_world[2] = {(T_world_body * cameras[LEFT]->T_body_camera).inverse(),
                                               (T_world_body * cameras[RIGHT]->T_body_camera).inverse()};
  std::normal_distribution<double> normal;
  std::vector<std::pair<size_t, FeatureObservation>> seen;
  for (size_t i = 0; i < landmarks_.size(); ++i)
  {
    const Landmark& landmark = landmarks_[i];
    FeatureObservation feature;
    for (const int camera : {LEFT, RIGHT})
    {
      feature.pixel[camera].setZero();
      feature.bearing[camera].setZero();
      Eigen::Vector3d p_camera = T_camera_world[camera] * (landmark.p_world + time_s * landmark.v_world);
      std::optional<Eigen::Vector2d> pixel;
      if (p_camera.z() > 0.2 && p_camera.norm() < 1.5 * options_.max_range)
      {
        pixel = cameras[camera]->model.project(p_camera);
      }
      for (int i = 0; i < 3 && pixel && options_.readout_s > 0.0; ++i)
      {
        const double late_s = options_.readout_s * (pixel->y() / (cameras[camera]->model.height - 1) - 0.5);
        const int64_t row_ns =
            std::clamp(stamp_ns + static_cast<int64_t>(1e9 * late_s), trajectory_.startNs(), trajectory_.endNs());
        p_camera = (trajectory_.at(row_ns).T_world_body * cameras[camera]->T_body_camera).inverse() *
                   (landmark.p_world + (time_s + late_s) * landmark.v_world);
        pixel = p_camera.z() > 0.2 ? cameras[camera]->model.project(p_camera) : std::nullopt;
      }
      if (!pixel)
      {
        continue;
      }
      *pixel += options_.pixel_noise * Eigen::Vector2d{normal(random_), normal(random_)};
      *pixel += camera == RIGHT ? landmark.mismatch : Eigen::Vector2d::Zero();
      const std::optional<Eigen::Vector3d> bearing = cameras[camera]->model.unproject(*pixel);
      if (cameras[camera]->model.contains(*pixel) && bearing)
      {
        feature.seen[camera] = true;
        feature.pixel[camera] = pixel->cast<float>();
        feature.bearing[camera] = *bearing;
      }
    }
    if (feature.seen[LEFT] || feature.seen[RIGHT])
    {
      seen.emplace_back(i, feature);
    }
  }
  // Those that are tracked already come first.
  std::stable_sort(seen.begin(), seen.end(),
                   [&](const auto& a, const auto& b)
                   { return (landmarks_[a.first].id >= 0) > (landmarks_[b.first].id >= 0); });
  seen.resize(std::min(seen.size(), static_cast<size_t>(options_.max_features)));

  std::vector<Landmark> now = landmarks_;
  for (Landmark& landmark : now)
  {
    landmark.id = -1;
  }
  FrameFeatures frame;
  frame.stamp_ns = stamp_ns;
  for (auto& [i, feature] : seen)
  {
    const bool tracked = landmarks_[i].id >= 0;
    now[i].id = tracked ? landmarks_[i].id : next_id_++;
    now[i].age = tracked ? landmarks_[i].age + 1 : 0;
    landmark_of_id_[now[i].id] = i;
    feature.id = now[i].id;
    feature.age = now[i].age;
    frame.features.push_back(feature);
  }
  landmarks_ = std::move(now);
  std::sort(frame.features.begin(), frame.features.end(),
            [](const FeatureObservation& a, const FeatureObservation& b) { return a.id < b.id; });
  return frame;
}

std::optional<Eigen::Vector3d> SimulatedFeatures::p_world(int64_t id) const
{
  const auto found = landmark_of_id_.find(id);
  return found == landmark_of_id_.end() ? std::nullopt
                                        : std::optional<Eigen::Vector3d>(landmarks_[found->second].p_world);
}

bool SimulatedFeatures::isOutlier(int64_t id) const
{
  const auto found = landmark_of_id_.find(id);
  return found != landmark_of_id_.end() && landmarks_[found->second].outlier;
}
