#include "renderer/tiled_picture.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
{

RayTable::RayTable(const pi_slam::CameraModel& camera)
  : tiling_(camera.width, camera.height)
  , x_(tiling_.size())
  , y_(tiling_.size())
  , z_(tiling_.size(), 1.0f)
  , spread_(tiling_.size(), 0.0f)
{
  for (int tile = 0; tile < tiling_.tiles(); ++tile)
  {
    Eigen::Vector3d neighbour = Eigen::Vector3d::UnitZ();
    bool known = false;
    // Twice, so that lanes before the first good one get its direction too.
    for (int pass = 0; pass < 2; ++pass)
    {
      for (int lane = 0; lane < LANES; ++lane)
      {
        const int column = std::min(tile % tiling_.columns * Tiling::SIDE + lane % Tiling::SIDE, camera.width - 1);
        const int row = std::min(tile / tiling_.columns * Tiling::SIDE + lane / Tiling::SIDE, camera.height - 1);
        const std::optional<Eigen::Vector3d> ray = camera.unproject({column, row});
        const std::optional<Eigen::Vector3d> right = camera.unproject({column + 1.0, row});
        const std::optional<Eigen::Vector3d> below = camera.unproject({column, row + 1.0});
        const size_t i = static_cast<size_t>(tile) * LANES + static_cast<size_t>(lane);
        if (ray && right && below)
        {
          neighbour = *ray;
          known = true;
          spread_[i] = static_cast<float>(std::sqrt((*right - *ray).norm() * (*below - *ray).norm()));
        }
        x_[i] = static_cast<float>(neighbour.x());
        y_[i] = static_cast<float>(neighbour.y());
        z_[i] = static_cast<float>(neighbour.z());
      }
      if (spread_[static_cast<size_t>(tile) * LANES] > 0.0f || !known)
      {
        break;
      }
    }
  }
  for (int tile = 0; tile < tiling_.tiles(); ++tile)
  {
    const float* spread = &spread_[static_cast<size_t>(tile) * LANES];
    sees_all_.push_back(std::all_of(spread, spread + LANES, [](float angle) { return angle > 0.0f; }));
    tile_frusta_.push_back(frustumAround({tile}));
  }
  for (int block = 0; block < tiling_.blocks(); ++block)
  {
    std::vector<int> tiles;
    tiling_.forBlock(block, [&](int tile) { tiles.push_back(tile); });
    block_frusta_.push_back(frustumAround(tiles));
  }
}

FrustumNormals RayTable::frustumAround(const std::vector<int>& tiles) const
{
  constexpr float ROUNDING = 2e-4f;  // of the slopes
  Eigen::Vector3f axis = Eigen::Vector3f::Zero();
  float widest = 0.0f;
  const auto forRays = [&](const auto& work)
  {
    for (const int tile : tiles)
    {
      for (size_t i = static_cast<size_t>(tile) * LANES; i < static_cast<size_t>(tile + 1) * LANES; ++i)
      {
        work(i);
      }
    }
  };
  forRays(
      [&](size_t i)
      {
        axis += ray(i);
        widest = std::max(widest, spread_[i]);
      });
  axis.normalize();
  const Eigen::Vector3f u = axis.unitOrthogonal();
  const Eigen::Vector3f v = axis.cross(u);
  Eigen::Array2f low(1e30f, 1e30f);
  Eigen::Array2f high(-1e30f, -1e30f);
  forRays(
      [&](size_t i)
      {
        const Eigen::Vector3f d = ray(i);
        const float depth = std::max(d.dot(axis), 1e-3f);
        const Eigen::Array2f slope = Eigen::Array2f(d.dot(u), d.dot(v)) / depth;
        const float margin = 0.6f * widest / (depth * depth) + ROUNDING;  // for the rays beside a pixel's centre
        low = low.min(slope - margin);
        high = high.max(slope + margin);
      });
  return {u - high[0] * axis, low[0] * axis - u, v - high[1] * axis, low[1] * axis - v};
}

PI_SIMULATION_VECTORISED void RayTable::fill(int tile, const Eigen::Matrix3f& R, RayPacket* packet) const
{
  const size_t first = static_cast<size_t>(tile) * LANES;
  const float* x = &x_[first];
  const float* y = &y_[first];
  const float* z = &z_[first];
  const float* spread = &spread_[first];
  const float r00 = R(0, 0), r01 = R(0, 1), r02 = R(0, 2);
  const float r10 = R(1, 0), r11 = R(1, 1), r12 = R(1, 2);
  const float r20 = R(2, 0), r21 = R(2, 1), r22 = R(2, 2);
  for (int i = 0; i < LANES; ++i)
  {
    packet->dx[i] = r00 * x[i] + r01 * y[i] + r02 * z[i];
    packet->dy[i] = r10 * x[i] + r11 * y[i] + r12 * z[i];
    packet->dz[i] = r20 * x[i] + r21 * y[i] + r22 * z[i];
    packet->spread[i] = spread[i];
  }
}

void RayTable::fillSubpixel(int x, int y, float offset_x, float offset_y, const Eigen::Matrix3f& R_world_camera,
                            int lane, RayPacket* packet) const
{
  // Differences to the next pixels inside of the picture.
  const int ox = x + 1 < tiling_.width ? 1 : -1;
  const int oy = y + 1 < tiling_.height ? 1 : -1;
  const size_t i = tiling_.index(x, y);
  const Eigen::Vector3f center = ray(i);
  const Eigen::Vector3f step_x = (ray(tiling_.index(x + ox, y)) - center) * static_cast<float>(ox);
  const Eigen::Vector3f step_y = (ray(tiling_.index(x, y + oy)) - center) * static_cast<float>(oy);
  const Eigen::Vector3f d = R_world_camera * (center + offset_x * step_x + offset_y * step_y).normalized();
  packet->dx[lane] = d.x();
  packet->dy[lane] = d.y();
  packet->dz[lane] = d.z();
  packet->spread[lane] = 0.5f * spread_[i];
}

}  // namespace pi_simulation::synthetic
