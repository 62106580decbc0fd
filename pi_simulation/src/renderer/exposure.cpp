#include "renderer/exposure.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

/// Nearly normal random number of a pixel: sum of four uniform ones (Irwin-Hall), standard deviation 1, within +-3.5.
inline float normal(int pixel, uint32_t seed)
{
  const uint32_t a = hashCell(pixel, 1, seed);
  const uint32_t b = hashCell(pixel, 2, seed);
  const auto sum = static_cast<int32_t>((a & 0xFFFFu) + (a >> 16) + (b & 0xFFFFu) + (b >> 16));
  return (static_cast<float>(sum) * 0x1p-16f - 2.0f) * 1.7320508f;
}

struct Sensor
{
  float scale;
  float shot_noise;
  float read_variance;
  uint32_t seed;
};

PI_SIMULATION_VECTORISED void expose(const float* light, const float* vignette, const Sensor& sensor, int first_pixel,
                                     uint8_t* grey)
{
  const float scale = sensor.scale;
  const float shot = sensor.shot_noise;
  const float read = sensor.read_variance;
  const uint32_t seed = sensor.seed;
  int32_t values[LANES];
  for (int i = 0; i < LANES; ++i)
  {
    const float value = light[i] * vignette[i] * scale;
    const float noisy = value + std::sqrt(shot * value + read) * normal(first_pixel + i, seed);
    values[i] = static_cast<int32_t>(std::min(std::max(noisy + 0.5f, 0.0f), 255.0f));
  }
  for (int i = 0; i < LANES; ++i)
  {
    grey[i] = static_cast<uint8_t>(values[i]);
  }
}

}  // namespace

Exposure::Exposure(const RayTable& rays, const pi_slam::CameraModel& camera, const StereoRendererOptions& options)
  : tiling_(rays.tiling()), options_(options), vignette_(tiling_.size(), 0.0f)
{
  const double corner =
      std::hypot(std::max(camera.cx, camera.width - 1 - camera.cx), std::max(camera.cy, camera.height - 1 - camera.cy));
  for (int y = 0; y < camera.height; ++y)
  {
    for (int x = 0; x < camera.width; ++x)
    {
      const double radius = std::hypot(x - camera.cx, y - camera.cy) / corner;
      vignette_[tiling_.index(x, y)] = static_cast<float>(1.0 - options.vignetting * radius * radius);
    }
  }
}

double Exposure::gain(int64_t stamp_ns) const
{
  // Two waves, at periods that do not repeat within an hour.
  const double t = 1e-9 * static_cast<double>(stamp_ns % 3600000000000LL);
  const double phase = 0.7 * static_cast<double>(options_.seed % 1000);
  return 1.0 + options_.gain_variation * (0.6 * std::sin(2.0 * M_PI * t / 7.13 + phase) +
                                          0.4 * std::sin(2.0 * M_PI * t / 2.31 + 2.0 * phase));
}

void Exposure::developChannel(const std::vector<float>& light, float scale, uint32_t seed, int channel,
                              cv::Mat* picture) const
{
  const auto read = static_cast<float>(options_.read_noise * options_.read_noise);
  const Sensor sensor{scale, static_cast<float>(options_.shot_noise), read, seed};
  const int channels = picture->channels();
  uint8_t grey[LANES];
  for (int tile = 0; tile < tiling_.tiles(); ++tile)
  {
    const size_t first = static_cast<size_t>(tile) * LANES;
    expose(&light[first], &vignette_[first], sensor, tile * LANES, grey);
    const int left = tile % tiling_.columns * Tiling::SIDE;
    const int top = tile / tiling_.columns * Tiling::SIDE;
    for (int y = top; y < std::min(top + Tiling::SIDE, tiling_.height); ++y)
    {
      uint8_t* row = picture->ptr<uint8_t>(y);
      for (int x = left; x < std::min(left + Tiling::SIDE, tiling_.width); ++x)
      {
        row[x * channels + channel] = grey[(y - top) * Tiling::SIDE + x - left];
      }
    }
  }
}

cv::Mat Exposure::develop(const Radiance& light, int64_t stamp_ns, uint32_t stream) const
{
  cv::Mat picture(tiling_.height, tiling_.width, options_.color ? CV_8UC3 : CV_8UC1);
  const auto scale = static_cast<float>(255.0 * options_.brightness * gain(stamp_ns));
  const uint32_t seed = hashCell(static_cast<int>(stamp_ns / 1000 & 0x7FFFFFFF), static_cast<int>(stream),
                                 static_cast<uint32_t>(options_.seed) + static_cast<uint32_t>(stamp_ns >> 32));
  if (options_.color)
  {
    developChannel(light.b, scale, seed, 0, &picture);
    developChannel(light.g, scale, seed + 1u, 1, &picture);
    developChannel(light.r, scale, seed + 2u, 2, &picture);
  }
  else
  {
    developChannel(light.r, scale, seed, 0, &picture);
  }
  return picture;
}

}  // namespace pi_simulation::synthetic
