#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include <pi_runtime/buffer.h>
#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/fast_corners.h>
#include <pi_runtime/kernels/lucas_kanade.h>
#include <pi_runtime/kernels/pyramid.h>

namespace pi_runtime
{
class Runtime;
}

namespace pi_slam::front_end
{

using Pixel = pi_runtime::kernels::Point2f;
using Pyramid = pi_runtime::BufferPtr;
using Picture = pi_runtime::ImageView<const uint8_t>;

/// Points to be tracked, and what came out.
struct PointBatch
{
  std::vector<Pixel> from;
  std::vector<Pixel> to;  ///< guesses, then results
  std::vector<uint8_t> status;
  std::vector<float> residual;  ///< mean absolute difference [grey levels]

  void clear();
  void add(const Pixel& point, const Pixel& guess);
  size_t size() const { return from.size(); }
};

/// One batch and the pictures that it goes between.
struct Flow
{
  const Pyramid* from = nullptr;
  const Pyramid* to = nullptr;
  int levels = 1;  ///< of the pyramids that are used, from the full picture on
  PointBatch* points = nullptr;
};

struct FlowOptions
{
  int window_px = 15;
  int max_iterations = 12;
  double epsilon_px = 0.02;
};

/// The heavy stages of the front end, for pictures of one size: kernels of pi_runtime, called directly or as tasks of a
/// runtime, which gives the same results. A task that fails (a unit that left) is done here instead. Not thread safe.
class PictureKernels
{
public:
  /// @param runtime  null: direct calls.
  PictureKernels(int width, int height, int levels, const FlowOptions& options,
                 std::shared_ptr<pi_runtime::Runtime> runtime);
  ~PictureKernels();

  Pyramid makePyramid() const;
  /// @param pictures  CV_8UC1 of this size; null ones are left out.
  void build(const std::array<const cv::Mat*, 2>& pictures, const std::array<Pyramid, 2>& pyramids);
  /// Tracks all batches; with a runtime at the same time. Batches without points are left out.
  void track(const std::vector<Flow>& flows);
  /// FAST corners of the full picture, by row, then column.
  void findCorners(const Pyramid& pyramid, int threshold, std::vector<pi_runtime::kernels::Corner>* corners);

  int levels() const { return layout_.levels; }
  /// A level of a pyramid as it is now.
  Picture view(const Pyramid& pyramid, int level) const;

private:
  struct Tasks;
  pi_runtime::kernels::TrackOptions trackOptions(int levels) const;
  void trackHere(const Flow& flow) const;

  const pi_runtime::kernels::PyramidLayout layout_;
  const FlowOptions options_;
  std::unique_ptr<Tasks> tasks_;  ///< null: direct calls
};

}  // namespace pi_slam::front_end
