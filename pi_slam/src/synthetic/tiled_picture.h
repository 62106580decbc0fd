#pragma once

#include <pi_slam/camera_model.h>

#include <cstdint>
#include <vector>

#include "ray_packet.h"

namespace pi_slam::synthetic
{

/// Order of a picture's pixels in memory: tiles of 8x8 pixels, each the 64 lanes of a RayPacket.
struct Tiling
{
  static constexpr int SIDE = 8;

  Tiling(int picture_width, int picture_height)
    : width(picture_width), height(picture_height), columns((width + SIDE - 1) / SIDE), rows((height + SIDE - 1) / SIDE)
  {
  }
  int tiles() const { return columns * rows; }
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
};

/// Direction of every pixel in the camera frame, computed once from the camera model.
class RayTable
{
public:
  explicit RayTable(const CameraModel& camera);

  const Tiling& tiling() const { return tiling_; }
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
  Eigen::Vector3f ray(size_t index) const { return {x_[index], y_[index], z_[index]}; }

  Tiling tiling_;
  std::vector<float> x_;
  std::vector<float> y_;
  std::vector<float> z_;
  std::vector<float> spread_;  ///< angle to the next pixel [rad]; 0: sees nothing
};

/// Light that reaches the pixels, in the order of a Tiling.
struct Radiance
{
  std::vector<float> r;  ///< grey in pictures without colour, then g and b are empty
  std::vector<float> g;
  std::vector<float> b;
};

}  // namespace pi_slam::synthetic
