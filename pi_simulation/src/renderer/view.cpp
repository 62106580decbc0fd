#include "renderer/view.h"

#include <algorithm>
#include <atomic>
#include <set>

namespace pi_simulation::synthetic
{

namespace
{

constexpr int SUBRAYS = 4;
/// Rotated grid.
constexpr float OFFSETS[SUBRAYS][2] = {{-0.125f, -0.375f}, {0.375f, -0.125f}, {0.125f, 0.375f}, {-0.375f, 0.125f}};

/// Luma of ITU-R BT.601.
inline float grey(float r, float g, float b)
{
  return 0.299f * r + 0.587f * g + 0.114f * b;
}

void addTo(std::vector<float>* sum, const std::vector<float>& values, float weight)
{
  for (size_t i = 0; i < sum->size(); ++i)
  {
    (*sum)[i] += weight * values[i];
  }
}

}  // namespace

View::View(const pi_slam::CameraModel& camera, bool color, bool quick, WorkerPool* pool)
  : rays_(camera), color_(color), quick_(quick), pool_(pool)
{
  const Tiling& tiling = rays_.tiling();
  surface_.resize(static_cast<size_t>(tiling.width) * static_cast<size_t>(tiling.height));
  radiance_.r.resize(tiling.size());
  radiance_.g.resize(color ? tiling.size() : 0);
  radiance_.b.resize(color ? tiling.size() : 0);
}

/// Mean of `count` lanes from `lane` on as the colour of one pixel.
void View::store(const RayPacket& packet, size_t index, int lane, int count)
{
  float r = 0.0f;
  float g = 0.0f;
  float b = 0.0f;
  for (int i = lane; i < lane + count; ++i)
  {
    r += packet.r[i];
    g += packet.g[i];
    b += packet.b[i];
  }
  const float scale = 1.0f / static_cast<float>(count);
  radiance_.r[index] = scale * (color_ ? r : grey(r, g, b));
  if (color_)
  {
    radiance_.g[index] = scale * g;
    radiance_.b[index] = scale * b;
  }
}

void View::castTile(const Shot& shot, const TileRays& rays, int tile, bool edges)
{
  RayPacket packet;
  packet.origin = rays.origin;
  rays_.fill(tile, rays.R, &packet);
  trace(shot.scene, rays.candidates, Frustum(rays_.tileFrustum(tile), rays.R, rays.origin), &packet);
  shade(shot.scene, shot.moving, quick_, &packet);
  const size_t first = static_cast<size_t>(tile) * LANES;
  if (!rays_.seesAll(tile))
  {
    for (int lane = 0; lane < LANES; ++lane)
    {
      if (!rays_.sees(first + static_cast<size_t>(lane)))
      {
        packet.r[lane] = packet.g[lane] = packet.b[lane] = 0.0f;
      }
    }
  }
  if (color_)
  {
    std::copy_n(packet.r, LANES, &radiance_.r[first]);
    std::copy_n(packet.g, LANES, &radiance_.g[first]);
    std::copy_n(packet.b, LANES, &radiance_.b[first]);
  }
  else
  {
    for (int lane = 0; lane < LANES; ++lane)
    {
      radiance_.r[first + static_cast<size_t>(lane)] = grey(packet.r[lane], packet.g[lane], packet.b[lane]);
    }
  }
  if (!edges)
  {
    return;
  }
  const Tiling& tiling = rays_.tiling();
  const int left = tile % tiling.columns * Tiling::SIDE;
  const int top = tile / tiling.columns * Tiling::SIDE;
  for (int y = top; y < std::min(top + Tiling::SIDE, tiling.height); ++y)
  {
    int32_t* row = &surface_[static_cast<size_t>(y) * static_cast<size_t>(tiling.width)];
    for (int x = left; x < std::min(left + Tiling::SIDE, tiling.width); ++x)
    {
      const int lane = (y - top) * Tiling::SIDE + x - left;
      row[x] = packet.hit[lane] * 8 + packet.face[lane];
    }
  }
}

bool View::isEdge(int x, int y) const
{
  const int32_t* own =
      &surface_[static_cast<size_t>(y) * static_cast<size_t>(rays_.tiling().width) + static_cast<size_t>(x)];
  const int left = x > 0 ? -1 : 0;
  const int right = x + 1 < rays_.tiling().width ? 1 : 0;
  const int above = y > 0 ? -rays_.tiling().width : 0;
  const int below = y + 1 < rays_.tiling().height ? rays_.tiling().width : 0;
  return own[left] != *own || own[right] != *own || own[above] != *own || own[below] != *own;
}

void View::refineTile(const Shot& shot, const TileRays& rays, int tile, bool everywhere)
{
  const Eigen::Matrix3f& R = rays.R;
  const Frustum frustum(rays_.tileFrustum(tile), R, rays.origin);
  const Tiling& tiling = rays_.tiling();
  const int left = tile % tiling.columns * Tiling::SIDE;
  const int top = tile / tiling.columns * Tiling::SIDE;
  RayPacket packet;
  packet.origin = rays.origin;
  size_t pixels[LANES / SUBRAYS];
  int lanes = 0;
  const auto flush = [&]
  {
    for (int i = lanes; i < LANES; ++i)
    {
      packet.dx[i] = packet.dx[0];
      packet.dy[i] = packet.dy[0];
      packet.dz[i] = packet.dz[0];
      packet.spread[i] = packet.spread[0];
    }
    trace(shot.scene, rays.candidates, frustum, &packet);
    shade(shot.scene, shot.moving, quick_, &packet);
    for (int i = 0; i < lanes; i += SUBRAYS)
    {
      store(packet, pixels[i / SUBRAYS], i, SUBRAYS);
    }
    lanes = 0;
  };
  for (int y = top; y < std::min(top + Tiling::SIDE, tiling.height); ++y)
  {
    for (int x = left; x < std::min(left + Tiling::SIDE, tiling.width); ++x)
    {
      const size_t i = tiling.index(x, y);
      if (!rays_.sees(i) || (!everywhere && !isEdge(x, y)))
      {
        continue;
      }
      pixels[lanes / SUBRAYS] = i;
      for (const auto& offset : OFFSETS)
      {
        rays_.fillSubpixel(x, y, offset[0], offset[1], R, lanes++, &packet);
      }
      if (lanes == LANES)
      {
        flush();
      }
    }
  }
  if (lanes > 0)
  {
    flush();
  }
}

template <typename Work>
void View::forTiles(const Shot& shot, const Work& work)
{
  const Tiling& tiling = rays_.tiling();
  pool_->run(
      tiling.block_rows,
      [&](int row)
      {
        TileRays rays{shot.T_world_camera.translation().cast<float>(), shot.T_world_camera.linear().cast<float>(), {}};
        for (int block = row * tiling.block_columns; block < (row + 1) * tiling.block_columns; ++block)
        {
          rays.candidates.find(shot.scene, shot.moving, Frustum(rays_.blockFrustum(block), rays.R, rays.origin));
          tiling.forBlock(block, [&](int tile) { work(rays, tile); });
        }
      });
}

void View::cast(const Shot& shot, bool edges, bool everywhere, float weight, Radiance* sum)
{
  if (!everywhere)
  {
    forTiles(shot, [&](const TileRays& rays, int tile) { castTile(shot, rays, tile, edges); });
  }
  if (edges || everywhere)
  {
    forTiles(shot, [&](const TileRays& rays, int tile) { refineTile(shot, rays, tile, everywhere); });
  }
  addTo(&sum->r, radiance_.r, weight);
  addTo(&sum->g, radiance_.g, weight);
  addTo(&sum->b, radiance_.b, weight);
}

void View::castTruth(const Shot& shot, cv::Mat* depth, cv::Mat* objects, std::vector<int>* silhouettes)
{
  std::vector<std::atomic<int>> whole(shot.scene.objects.size() + 1);
  const Tiling& tiling = rays_.tiling();
  depth->create(tiling.height, tiling.width, CV_32FC1);
  objects->create(tiling.height, tiling.width, CV_32SC1);
  const auto castTile = [&](const TileRays& rays, int tile)
  {
    RayPacket packet;
    packet.origin = rays.origin;
    rays_.fill(tile, rays.R, &packet);
    trace(shot.scene, rays.candidates, Frustum(rays_.tileFrustum(tile), rays.R, rays.origin), &packet);
    for (int lane = 0; lane < LANES; ++lane)
    {
      const int x = tile % tiling.columns * Tiling::SIDE + lane % Tiling::SIDE;
      const int y = tile / tiling.columns * Tiling::SIDE + lane / Tiling::SIDE;
      if (x >= tiling.width || y >= tiling.height)
      {
        continue;
      }
      const size_t i = tiling.index(x, y);
      const int32_t id = rays_.sees(i) ? packet.hit[lane] : RayPacket::SKY;
      const auto index = static_cast<size_t>(id);
      const size_t fixed = shot.scene.primitives.size();
      depth->at<float>(y, x) = id == RayPacket::SKY ? 0.0f : packet.t[lane] * rays_.cosine(i);
      objects->at<int32_t>(y, x) = id == RayPacket::SKY ? 0
                                   : index < fixed      ? shot.scene.primitives[index].object
                                                        : shot.moving.primitives[index - fixed].object;
    }
    std::set<int32_t> near;
    for (const Candidates::Entry& entry : rays.candidates.entries)
    {
      near.insert(entry.primitive->object);
    }
    near.erase(0);
    for (const int32_t object : near)
    {
      uint64_t lanes =
          silhouette(rays.candidates, Frustum(rays_.tileFrustum(tile), rays.R, rays.origin), object, &packet);
      for (int lane = 0; lane < LANES; ++lane)
      {
        const int x = tile % tiling.columns * Tiling::SIDE + lane % Tiling::SIDE;
        const int y = tile / tiling.columns * Tiling::SIDE + lane / Tiling::SIDE;
        const bool seen = x < tiling.width && y < tiling.height && rays_.sees(tiling.index(x, y));
        whole[static_cast<size_t>(object)] += seen && (lanes >> lane & 1U) != 0 ? 1 : 0;
      }
    }
  };
  forTiles(shot, castTile);
  silhouettes->assign(whole.begin(), whole.end());
}

}  // namespace pi_simulation::synthetic
