#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <pi_runtime/buffer.h>
#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/fast_corners.h>
#include <pi_runtime/kernels/pyramid.h>

namespace pi_runtime_bench
{

/// Amount of work of one job, chosen for the machine and then equal for all contenders.
struct WorkSize
{
  int32_t points = 0;        ///< corners that the front end matches between the pictures
  int32_t layers = 0;        ///< of the network of the detection
  double front_end_s = 0.0;  ///< what a job with these points takes

  /// As much as takes the typical times of the rhythms on one core of this machine as it is now; a front end of all
  /// corners that there are may take less on a quick one.
  static WorkSize forThisMachine();
};

/// Rhythm of a stream of jobs.
struct Rhythm
{
  double period_s;
  double deadline_s;
  double typical_s;  ///< of one job
  double longest_s;  ///< for the admission: typical time with a margin that lets both fit on one unit
};
constexpr Rhythm DRIVE_FRONT_END{1.0 / 30.0, 0.033, 0.003, 0.0045};
constexpr Rhythm DRIVE_DETECTION{0.1, 0.1, 0.070, 0.080};
constexpr Rhythm DRIVE_INERTIAL{0.005, 0.005, 1e-6, 50e-6};

/// Front end of a stereo SLAM: image pyramids of both pictures (4 levels), FAST corners on all levels of the left one,
/// and for the first `points` corners of its full size the disparity by the sum of absolute differences.
struct FrontEndFrame
{
  static constexpr int WIDTH = 640;
  static constexpr int HEIGHT = 480;
  static constexpr int LEVELS = 4;
  static constexpr int MAX_CORNERS = 4096;  ///< kept per level

  const uint8_t* left;
  const uint8_t* right;
  uint8_t* left_pyramid;
  uint8_t* right_pyramid;
  pi_runtime::kernels::Corner* corners;  ///< MAX_CORNERS for each level
  int32_t* disparities;                  ///< MAX_CORNERS; [px]
};
/// @return the number of corners matched.
int runFrontEnd(const FrontEndFrame& frame, int points);

/// Stand-in for the network of an object detector: layers of 3 x 3 convolutions with a clipped ReLU on maps of CHANNELS
/// x HEIGHT x WIDTH, each stored with a border of zeros. Layer i reads map i % 2 and writes the other one. A job begins
/// with what the one before has left: bias and clipping keep the values in [0, 6] for ever, and none of them denormal.
struct Network
{
  static constexpr int CHANNELS = 16;
  static constexpr int WIDTH = 64;
  static constexpr int HEIGHT = 48;
  static constexpr int STRIDE = WIDTH + 2;
  static constexpr int PLANE = STRIDE * (HEIGHT + 2);
  static constexpr size_t MAP_FLOATS = static_cast<size_t>(CHANNELS) * PLANE;
  static constexpr size_t WEIGHT_FLOATS = static_cast<size_t>(CHANNELS) * CHANNELS * 9;
};
/// Computes rows [begin, end) of all layers together: row r is row r % HEIGHT of layer r / HEIGHT.
/// @param maps  2 * MAP_FLOATS. @param weights  WEIGHT_FLOATS, [out][in][3][3].
void runNetwork(float* maps, const float* weights, uint64_t begin, uint64_t end);

/// "front_end", native. Range 1; buffers as the pointers of FrontEndFrame, in their order, then int32_t points.
pi_runtime::CodeletPtr frontEndCodelet();
/// "detection" or "detection_sliced", native and OpenCL. Range: HEIGHT * layers.
///   0 inout maps, 1 in weights
pi_runtime::CodeletPtr detectionCodelet(bool sliceable);
/// "inertial", native: propagates a covariance of 15 states once. Range 1.
///   0 inout INERTIAL_FLOATS floats
pi_runtime::CodeletPtr inertialCodelet();
void runInertial(float* covariance);
constexpr size_t INERTIAL_FLOATS = 15 * 15;

/// Memory of one front-end job with two pictures of a textured scene at a disparity of 12 px, and its arguments.
struct FrontEndMemory
{
  FrontEndMemory();
  FrontEndFrame frame() const;
  std::vector<pi_runtime::Argument> arguments(int32_t points) const;

  pi_runtime::BufferPtr left;
  pi_runtime::BufferPtr right;
  pi_runtime::BufferPtr left_pyramid;
  pi_runtime::BufferPtr right_pyramid;
  pi_runtime::BufferPtr corners;
  pi_runtime::BufferPtr disparities;
};

/// As above, of a detection job.
struct DetectionMemory
{
  DetectionMemory();
  std::vector<pi_runtime::Argument> arguments() const;

  pi_runtime::BufferPtr maps;
  pi_runtime::BufferPtr weights;
};

}  // namespace pi_runtime_bench
