#pragma once

#include "renderer/ray_packet.h"

#include <pi_slam/camera_model.h>

#include <algorithm>
#include <cstdint>
#include <vector>

namespace pi_simulation::synthetic
{

/// Order of a picture's pixels in memory: tiles of 8x8 pixels, each the 64 lanes of a RayPacket.
struct Tiling
{
  static constexpr int SIDE = 8;
  static constexpr int BLOCK_SIDE = 4;  ///< tiles; what their rays may meet is found for all of them together

  Tiling(int picture_width, int picture_height)
    : width(picture_width)
    , height(picture_height)
    , columns((width + SIDE - 1) / SIDE)
    , rows((height + SIDE - 1) / SIDE)
    , block_columns((columns + BLOCK_SIDE - 1) / BLOCK_SIDE)
    , block_rows((rows + BLOCK_SIDE - 1) / BLOCK_SIDE)
  {
  }
  int tiles() const { return columns * rows; }
  int blocks() const { return block_columns * block_rows; }
  /// Calls `work(tile)` for the tiles of a block.
  template <typename Work>
  void forBlock(int block, const Work& work) const
  {
    const int left = block % block_columns * BLOCK_SIDE;
    const int top = block / block_columns * BLOCK_SIDE;
    for (int row = top; row < std::min(top + BLOCK_SIDE, rows); ++row)
    {
      for (int column = left; column < std::min(left + BLOCK_SIDE, columns); ++column)
      {
        work(row * columns + column);
      }
    }
  }
  size_t size() const { return static_cast<size_t>(tiles()) * LANES; }
  size_t index(int x, int y) const
  {
    return static_cast<size_t>((y / SIDE) * columns + x / SIDE) * LANES +
           static_cast<size_t>((y % SIDE) * SIDE + x % SIDE);
  }

  int width;
  int height;
  int columns;
  int rows;
  int block_columns;
  int block_rows;
};

/// Direction of every pixel in the camera frame, computed once from the camera model.
class RayTable
{
public:
  explicit RayTable(const pi_slam::CameraModel& camera);

  const Tiling& tiling() const { return tiling_; }
  /// Planes around the rays of a tile, and around those of a block, half a pixel wider, in the camera frame.
  const FrustumNormals& tileFrustum(int tile) const { return tile_frusta_[static_cast<size_t>(tile)]; }
  const FrustumNormals& blockFrustum(int block) const { return block_frusta_[static_cast<size_t>(block)]; }
  /// True if the camera model sees something in every pixel of a tile.
  bool seesAll(int tile) const { return sees_all_[static_cast<size_t>(tile)]; }
  /// False where the camera model sees nothing; such pixels carry a neighbour's direction.
  bool sees(size_t index) const { return spread_[index] > 0.0f; }
  /// Cosine between the pixel's ray and the optical axis.
  float cosine(size_t index) const { return z_[index]; }

  /// Turns a tile's rays into the world.
  void fill(int tile, const Eigen::Matrix3f& R_world_camera, RayPacket* packet) const;
  /// Sets one lane to the ray through (x + offset_x, y + offset_y), offsets within half a pixel, of the width of half a
  /// pixel.
  void fillSubpixel(int x, int y, float offset_x, float offset_y, const Eigen::Matrix3f& R_world_camera, int lane,
                    RayPacket* packet) const;

private:
  FrustumNormals frustumAround(const std::vector<int>& tiles) const;
  Eigen::Vector3f ray(size_t index) const { return {x_[index], y_[index], z_[index]}; }

  Tiling tiling_;
  std::vector<float> x_;
  std::vector<float> y_;
  std::vector<float> z_;
  std::vector<float> spread_;  ///< angle to the next pixel [rad]; 0: sees nothing
  std::vector<FrustumNormals> tile_frusta_;
  std::vector<FrustumNormals> block_frusta_;
  std::vector<bool> sees_all_;
};

/// Light that reaches the pixels, in the order of a Tiling.
struct Radiance
{
  std::vector<float> r;  ///< grey in pictures without colour, then g and b are empty
  std::vector<float> g;
  std::vector<float> b;
};

}  // namespace pi_simulation::synthetic
