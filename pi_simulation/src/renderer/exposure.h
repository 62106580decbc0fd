#pragma once

#include "renderer/stereo_renderer.h"
#include "renderer/tiled_picture.h"

namespace pi_simulation::synthetic
{

/// Turns light into the grey values of a sensor: gain, vignetting, shot and read noise, eight bits.
class Exposure
{
public:
  Exposure(const RayTable& rays, const pi_slam::CameraModel& camera, const StereoRendererOptions& options);

  /// @param stream  number of the camera, so that the two have noise of their own.
  cv::Mat develop(const Radiance& light, int64_t stamp_ns, uint32_t stream) const;

private:
  double gain(int64_t stamp_ns) const;
  void developChannel(const std::vector<float>& light, float scale, uint32_t seed, int channel, cv::Mat* picture) const;

  Tiling tiling_;
  StereoRendererOptions options_;
  std::vector<float> vignette_;  ///< in the order of the tiling
};

}  // namespace pi_simulation::synthetic
