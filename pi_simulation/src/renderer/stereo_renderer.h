#pragma once

#include "world/synthetic_world.h"

#include <pi_slam/spline_trajectory.h>
#include <pi_slam/stereo_calibration.h>

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace pi_simulation
{

enum class Supersampling
{
  NONE,   ///< one ray per pixel; textures are filtered, outlines are jagged
  EDGES,  ///< four more rays where a pixel's neighbour sees another surface
  FULL,   ///< four rays in every pixel
};

enum class RenderQuality
{
  RECORDING,  ///< for pictures that are rendered once and used often
  LIVE,       ///< for pictures at their rate beside other work: cheaper random detail of textures, which looks alike
};

struct StereoRendererOptions
{
  int threads = 1;  ///< that share the rows of a picture; in [1, 64]. Pictures do not depend on it.
  RenderQuality quality = RenderQuality::RECORDING;
  Supersampling supersampling = Supersampling::EDGES;
  int blur_samples = 1;         ///< positions along the motion that are averaged; in [1, 16], 1: no motion blur
  double exposure_s = 0.008;    ///< time that the shutter is open, around the stamp; in [0, 0.1]
  double brightness = 1.15;     ///< grey value of white in full light is 255 times this; in (0, 10]
  double gain_variation = 0.0;  ///< amplitude of a slow change of both cameras' gain over time; in [0, 0.9]
  double vignetting = 0.3;      ///< part of the light lost in the farthest corner; in [0, 1]
  double shot_noise = 0.02;     ///< variance per grey level [grey levels]; 0 or more
  double read_noise = 0.8;      ///< standard deviation [grey levels]; 0 or more
  bool color = false;           ///< BGR in place of grey
  bool truth = false;           ///< fills depth, objects and silhouettes
  uint64_t seed = 1;            ///< of the noise and the gain

  /// Neither noise nor vignetting: grey values are the world's.
  static StereoRendererOptions makeIdeal();
  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

struct StereoFrame
{
  int64_t stamp_ns = 0;  ///< middle of the exposure
  cv::Mat left;          ///< CV_8UC1, or CV_8UC3 (BGR) with color
  cv::Mat right;
  cv::Mat depth;    ///< CV_32FC1, of the left picture, along the optical axis [m]; 0: sky, or a pixel that sees nothing
  cv::Mat objects;  ///< CV_32SC1, of the left picture: id of the obstacle, 0: none
  std::vector<int> silhouettes;  ///< pixels of each obstacle in the left picture, by its id, if nothing hid it
};

/// Ray-casts the pictures of a calibrated stereo camera in a synthetic world. The same options, world, pose and stamp
/// give the same pictures, whatever the number of threads and whatever was rendered before.
/// Not thread safe: one object per thread; a world may be shared.
class StereoRenderer
{
public:
  /// @throws std::invalid_argument for options or a camera out of range.
  StereoRenderer(std::shared_ptr<const SyntheticWorld> world, const pi_slam::StereoCalibration& calibration,
                 const StereoRendererOptions& options = StereoRendererOptions());
  ~StereoRenderer();

  /// Pictures along a motion, with its blur.
  /// @throws std::out_of_range if the stamp is outside of the trajectory.
  StereoFrame render(const pi_slam::SplineTrajectory& trajectory, int64_t stamp_ns);

  /// Pictures from a body at rest, without blur; the world is that of the stamp.
  /// @param actors  where those of SyntheticWorldOptions::actors are.
  StereoFrame render(const Eigen::Isometry3d& T_world_body, int64_t stamp_ns,
                     const std::vector<ActorState>& actors = {});

private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_simulation
