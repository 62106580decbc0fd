#include "vehicle/road_surface.h"

#include <cmath>
#include <random>

namespace pi_simulation
{

RoadSurface::RoadSurface(double scale, uint64_t seed)
{
  std::mt19937_64 random(seed);
  const auto part = [&random] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  const auto wave = [&](double amplitude, double length)
  {
    const double direction = 2.0 * M_PI * part();
    const double k = 2.0 * M_PI / length;
    return Wave{scale * amplitude, {k * std::cos(direction), k * std::sin(direction)}, 2.0 * M_PI * part()};
  };
  height_ = {wave(0.010, 7.3), wave(0.004, 2.9), wave(0.001, 0.9)};
  pitch_ = {wave(0.004, 5.1), wave(0.003, 2.3)};
  roll_ = {wave(0.004, 6.1), wave(0.003, 1.9)};
}

double RoadSurface::Wave::at(const Eigen::Vector2d& p) const
{
  return amplitude * std::sin(k.dot(p) + phase);
}

Eigen::Isometry3d RoadSurface::T_world_base(double x, double y, double heading) const
{
  const Eigen::Vector2d p(x, y);
  double z = 0.0;
  double pitch = 0.0;
  double roll = 0.0;
  for (const Wave& wave : height_)
  {
    z += wave.at(p);
  }
  for (const Wave& wave : pitch_)
  {
    pitch += wave.at(p);
  }
  for (const Wave& wave : roll_)
  {
    roll += wave.at(p);
  }
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = Eigen::Vector3d(x, y, z);
  pose.linear() =
      (Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  return pose;
}

}  // namespace pi_simulation
