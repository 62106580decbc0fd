#pragma once

#include "renderer/tiled_picture.h"
#include "renderer/worker_pool.h"

#include <opencv2/core/mat.hpp>

namespace pi_simulation::synthetic
{

/// Casts the rays of one camera. Keeps its buffers from picture to picture; not thread safe.
class View
{
public:
  /// @param quick  RenderQuality::LIVE.
  View(const pi_slam::CameraModel& camera, bool color, bool quick, WorkerPool* pool);

  /// Where a picture is taken.
  struct Shot
  {
    const Scene& scene;
    const MovingScene& moving;
    Eigen::Isometry3d T_world_camera;
  };

  const RayTable& rays() const { return rays_; }

  /// Adds `weight` times what the camera sees to `sum`.
  /// @param everywhere  supersample every pixel; else, with `edges`, only those beside another surface.
  void cast(const Shot& shot, bool edges, bool everywhere, float weight, Radiance* sum);

  /// Depth along the optical axis [m] (0: nothing) and object ids, through the centres of the pixels.
  /// @param silhouettes  pixels of each object, by its id, if nothing hid it.
  void castTruth(const Shot& shot, cv::Mat* depth, cv::Mat* objects, std::vector<int>* silhouettes);

private:
  /// What the tiles of a block have in common.
  struct TileRays
  {
    Eigen::Vector3f origin;  ///< world [m]
    Eigen::Matrix3f R;       ///< camera to world
    Candidates candidates;
  };

  /// Calls `work(rays, tile)` for all tiles, on the threads of the pool.
  template <typename Work>
  void forTiles(const Shot& shot, const Work& work);
  void castTile(const Shot& shot, const TileRays& rays, int tile, bool edges);
  void refineTile(const Shot& shot, const TileRays& rays, int tile, bool everywhere);
  bool isEdge(int x, int y) const;
  void store(const RayPacket& packet, size_t index, int lane, int count);

  RayTable rays_;
  bool color_;
  bool quick_;
  WorkerPool* pool_;
  Radiance radiance_;
  std::vector<int32_t> surface_;  ///< primitive and face that each pixel sees, row by row
};

}  // namespace pi_simulation::synthetic
