#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

namespace pi_slam
{

enum class Distortion
{
  NONE,         ///< plain pinhole; coefficients unused
  RADTAN,       ///< radial-tangential: k1, k2, p1, p2 (Brown 1966; as in OpenCV and Kalibr), then k3, and k4 to k6 of
                ///< the rational model, as OpenCV orders them
  EQUIDISTANT,  ///< fisheye: k1 to k4 of theta (Kannala and Brandt 2006; as cv::fisheye and Kalibr's "equidistant")
};

/// Pinhole camera with lens distortion. Camera frame: z forward, x right, y down. Pixel (0, 0) is the centre of the
/// upper left pixel. All methods are const and may be called from any thread.
struct CameraModel
{
  int width = 0;    ///< [px]
  int height = 0;   ///< [px]
  double fx = 0.0;  ///< focal lengths and principal point [px]
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  Distortion distortion = Distortion::NONE;
  std::array<double, 8> coefficients{};  ///< those that the lens has not are 0

  /// Of the coefficients, how many files have to name: 4, with k3 5, with k4 to k6 8.
  size_t usedCoefficients() const;

  /// @throws std::invalid_argument that names the field, its value and the bound.
  void validate() const;

  /// @param p_camera point in the camera frame; its length does not matter.
  /// @return the pixel, which may lie outside of the picture; nullopt beyond the angle at which the distortion folds
  ///         back, and for z <= 0 without a fisheye.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_camera) const;

  /// @return unit vector in the camera frame; nullopt where the model sees nothing (outside of the image circle).
  std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& pixel) const;

  bool contains(const Eigen::Vector2d& pixel) const
  {
    return pixel.x() >= 0.0 && pixel.y() >= 0.0 && pixel.x() <= width - 1.0 && pixel.y() <= height - 1.0;
  }
};

}  // namespace pi_slam
