#include "renderer/stereo_renderer.h"

#include "renderer/exposure.h"
#include "renderer/view.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

namespace pi_simulation
{

StereoRendererOptions StereoRendererOptions::makeIdeal()
{
  StereoRendererOptions options;
  options.vignetting = 0.0;
  options.shot_noise = 0.0;
  options.read_noise = 0.0;
  return options;
}

void StereoRendererOptions::validate() const
{
  const auto check = [](bool good, const char* field, double value, const char* bound)
  {
    if (!good)
    {
      throw std::invalid_argument(std::string("renderer: ") + field + " = " + std::to_string(value) + ", must be " +
                                  bound);
    }
  };
  check(threads >= 1 && threads <= 64, "threads", threads, "in [1, 64]");
  check(blur_samples >= 1 && blur_samples <= 16, "blur_samples", blur_samples, "in [1, 16]");
  check(exposure_s >= 0.0 && exposure_s <= 0.1, "exposure_s", exposure_s, "in [0, 0.1] s");
  check(brightness > 0.0 && brightness <= 10.0, "brightness", brightness, "in (0, 10]");
  check(gain_variation >= 0.0 && gain_variation <= 0.9, "gain_variation", gain_variation, "in [0, 0.9]");
  check(vignetting >= 0.0 && vignetting <= 1.0, "vignetting", vignetting, "in [0, 1]");
  check(shot_noise >= 0.0 && shot_noise <= 100.0, "shot_noise", shot_noise, "in [0, 100]");
  check(read_noise >= 0.0 && read_noise <= 100.0, "read_noise", read_noise, "in [0, 100]");
}

class StereoRenderer::Impl
{
public:
  using PoseAt = std::function<Eigen::Isometry3d(int64_t)>;

  Impl(std::shared_ptr<const SyntheticWorld> world, const pi_slam::StereoCalibration& calibration,
       const StereoRendererOptions& options)
    : world_(std::move(world))
    , options_(options)
    , pool_(options.threads)
    , left_(calibration.left, options, &pool_)
    , right_(calibration.right, options, &pool_)
  {
  }

  StereoFrame render(const PoseAt& T_world_body, int samples, int64_t stamp_ns, const std::vector<ActorState>& actors)
  {
    const synthetic::Scene& scene = world_->scene();
    left_.clear();
    right_.clear();
    for (int k = 0; k < samples; ++k)
    {
      const double part = (k + 0.5) / samples - 0.5;
      const int64_t time_ns = stamp_ns + std::llround(1e9 * options_.exposure_s * part);
      const synthetic::MovingScene moving = scene.movingAt(time_ns, actors);
      const Eigen::Isometry3d pose = T_world_body(time_ns);
      left_.add(scene, moving, pose, 1.0f / static_cast<float>(samples));
      right_.add(scene, moving, pose, 1.0f / static_cast<float>(samples));
    }
    StereoFrame frame;
    frame.stamp_ns = stamp_ns;
    frame.left = left_.exposure.develop(left_.light, stamp_ns, 0);
    frame.right = right_.exposure.develop(right_.light, stamp_ns, 1);
    if (options_.truth)
    {
      const synthetic::MovingScene moving = scene.movingAt(stamp_ns, actors);
      left_.view.castTruth({scene, moving, T_world_body(stamp_ns) * left_.T_body_camera}, &frame.depth, &frame.objects,
                           &frame.silhouettes);
    }
    return frame;
  }

  const StereoRendererOptions& options() const { return options_; }

private:
  struct Camera
  {
    Camera(const pi_slam::MountedCamera& camera, const StereoRendererOptions& options, synthetic::WorkerPool* pool)
      : view(camera.model, options.color, options.quality == RenderQuality::LIVE, pool)
      , exposure(view.rays(), camera.model, options)
      , T_body_camera(camera.T_body_camera)
      , supersampling(options.supersampling)
    {
      const size_t size = view.rays().tiling().size();
      light.r.resize(size);
      light.g.resize(options.color ? size : 0);
      light.b.resize(options.color ? size : 0);
    }

    void clear()
    {
      for (std::vector<float>* channel : {&light.r, &light.g, &light.b})
      {
        std::fill(channel->begin(), channel->end(), 0.0f);
      }
    }

    void add(const synthetic::Scene& scene, const synthetic::MovingScene& moving, const Eigen::Isometry3d& T_world_body,
             float weight)
    {
      view.cast({scene, moving, T_world_body * T_body_camera}, supersampling == Supersampling::EDGES,
                supersampling == Supersampling::FULL, weight, &light);
    }

    synthetic::View view;
    synthetic::Exposure exposure;
    Eigen::Isometry3d T_body_camera;
    Supersampling supersampling;
    synthetic::Radiance light;
  };

  std::shared_ptr<const SyntheticWorld> world_;
  StereoRendererOptions options_;
  synthetic::WorkerPool pool_;
  Camera left_;
  Camera right_;
};

StereoRenderer::StereoRenderer(std::shared_ptr<const SyntheticWorld> world,
                               const pi_slam::StereoCalibration& calibration, const StereoRendererOptions& options)
{
  options.validate();
  calibration.left.model.validate();
  calibration.right.model.validate();
  if (world == nullptr)
  {
    throw std::invalid_argument("renderer: world is null, give one of SyntheticWorld::build");
  }
  impl_ = std::make_unique<Impl>(std::move(world), calibration, options);
}

StereoRenderer::~StereoRenderer() = default;

StereoFrame StereoRenderer::render(const pi_slam::SplineTrajectory& trajectory, int64_t stamp_ns)
{
  trajectory.at(stamp_ns);  // throws if outside; the exposure may reach a little beyond the ends
  const auto pose = [&](int64_t time_ns)
  { return trajectory.at(std::clamp(time_ns, trajectory.startNs(), trajectory.endNs())).T_world_body; };
  return impl_->render(pose, impl_->options().blur_samples, stamp_ns, {});
}

StereoFrame StereoRenderer::render(const Eigen::Isometry3d& T_world_body, int64_t stamp_ns,
                                   const std::vector<ActorState>& actors)
{
  return impl_->render([&](int64_t) { return T_world_body; }, 1, stamp_ns, actors);
}

}  // namespace pi_simulation
