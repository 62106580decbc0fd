#include "front_end/picture_kernels.h"

#include <pi_runtime/runtime.h>

#include <algorithm>
#include <cstring>
#include <optional>

namespace pi_slam::front_end
{

namespace kernels = pi_runtime::kernels;
using pi_runtime::Access;
using pi_runtime::Argument;
using pi_runtime::Buffer;
using pi_runtime::BufferPtr;

namespace
{

constexpr size_t MOST_CORNERS = 20000;  ///< of one picture; FAST goes by rows, so more would only lack the lower ones

/// A buffer that grows as it is needed, and stays.
void reserve(BufferPtr* buffer, size_t bytes)
{
  if (!*buffer || (*buffer)->bytes() < bytes)
  {
    *buffer = Buffer::allocate(std::max<size_t>(2 * bytes, 4096));
  }
}

}  // namespace

/// Copies of one batch that tasks work on.
struct BatchBuffers
{
  BufferPtr from;
  BufferPtr to;
  BufferPtr status;
  BufferPtr residual;

  void fill(const PointBatch& batch)
  {
    const size_t bytes = batch.size() * sizeof(Pixel);
    reserve(&from, bytes);
    reserve(&to, bytes);
    reserve(&status, batch.size());
    reserve(&residual, batch.size() * sizeof(float));
    std::memcpy(from->host(Access::WRITE), batch.from.data(), bytes);
    std::memcpy(to->host(Access::WRITE), batch.to.data(), bytes);
  }
  void read(PointBatch* batch) const
  {
    std::memcpy(batch->to.data(), to->host(Access::READ), batch->size() * sizeof(Pixel));
    std::memcpy(batch->status.data(), status->host(Access::READ), batch->size());
    std::memcpy(batch->residual.data(), residual->host(Access::READ), batch->size() * sizeof(float));
  }
};

void PointBatch::clear()
{
  from.clear();
  to.clear();
  status.clear();
  residual.clear();
}

void PointBatch::add(const Pixel& point, const Pixel& guess)
{
  from.push_back(point);
  to.push_back(guess);
  status.push_back(0);
  residual.push_back(0.0F);
}

struct PictureKernels::Tasks
{
  std::shared_ptr<pi_runtime::Runtime> runtime;
  pi_runtime::CodeletPtr image_pyramid = kernels::imagePyramidCodelet();
  pi_runtime::CodeletPtr track_points = kernels::trackPointsCodelet();
  pi_runtime::CodeletPtr fast_corners = kernels::fastCornersCodelet();
  std::vector<BatchBuffers> batches;
  BufferPtr corners;
  BufferPtr corner_count = Buffer::allocate(sizeof(uint32_t));
  BufferPtr corner_work;

  pi_runtime::TaskHandle submit(const pi_runtime::CodeletPtr& codelet, std::vector<Argument> arguments, uint64_t range)
  {
    pi_runtime::TaskRequest request;
    request.codelet = codelet;
    request.arguments = std::move(arguments);
    request.range = range;
    return runtime->submit(std::move(request));
  }
};

PictureKernels::PictureKernels(int width, int height, int levels, const FlowOptions& options,
                               std::shared_ptr<pi_runtime::Runtime> runtime)
  : layout_(width, height, levels), options_(options)
{
  trackOptions(levels).validate();
  if (runtime)
  {
    tasks_ = std::make_unique<Tasks>();
    tasks_->runtime = std::move(runtime);
  }
}

PictureKernels::~PictureKernels() = default;

Pyramid PictureKernels::makePyramid() const
{
  return Buffer::allocate(layout_.bytes);
}

Picture PictureKernels::view(const Pyramid& pyramid, int level) const
{
  return layout_.view(static_cast<const uint8_t*>(pyramid->host(Access::READ)), level);
}

kernels::TrackOptions PictureKernels::trackOptions(int levels) const
{
  kernels::TrackOptions options;
  options.width = layout_.level[0].width;
  options.height = layout_.level[0].height;
  options.levels = levels;  // the first levels of a pyramid lie where those of a smaller pyramid do
  options.window = options_.window_px;
  options.max_iterations = options_.max_iterations;
  options.epsilon = static_cast<float>(options_.epsilon_px);
  return options;
}

void PictureKernels::build(const std::array<const cv::Mat*, 2>& pictures, const std::array<Pyramid, 2>& pyramids)
{
  std::array<pi_runtime::TaskHandle, 2> handles;
  for (size_t i = 0; i < 2 && tasks_; ++i)
  {
    if (pictures[i] != nullptr)
    {
      const cv::Mat& picture = *pictures[i];
      const auto stride = static_cast<size_t>(picture.step[0]);
      const size_t bytes = stride * static_cast<size_t>(picture.rows - 1) + static_cast<size_t>(picture.cols);
      kernels::PyramidShape shape{};
      shape.width = picture.cols;
      shape.height = picture.rows;
      shape.source_stride = static_cast<int32_t>(stride);
      shape.levels = layout_.levels;
      handles[i] = tasks_->submit(tasks_->image_pyramid,
                                  {Argument::in(Buffer::wrap(static_cast<const void*>(picture.data), bytes)),
                                   Argument::out(pyramids[i]), Argument::value(shape)},
                                  1);
    }
  }
  for (size_t i = 0; i < 2; ++i)
  {
    if (pictures[i] != nullptr && !(handles[i].valid() && handles[i].wait().ok()))
    {
      const cv::Mat& picture = *pictures[i];
      kernels::buildPyramid({picture.ptr(), picture.cols, picture.rows, picture.step[0]}, layout_,
                            pyramids[i]->hostAs<uint8_t>(Access::WRITE));
    }
  }
}

void PictureKernels::trackHere(const Flow& flow) const
{
  PointBatch& points = *flow.points;
  kernels::trackPoints(static_cast<const uint8_t*>((*flow.from)->host(Access::READ)),
                       static_cast<const uint8_t*>((*flow.to)->host(Access::READ)), trackOptions(flow.levels),
                       points.from.data(), points.to.data(), points.status.data(), points.residual.data(), 0,
                       points.size());
}

void PictureKernels::track(const std::vector<Flow>& flows)
{
  if (!tasks_)
  {
    for (const Flow& flow : flows)
    {
      trackHere(flow);
    }
    return;
  }
  std::vector<pi_runtime::TaskHandle> handles(flows.size());
  tasks_->batches.resize(std::max(tasks_->batches.size(), flows.size()));
  for (size_t i = 0; i < flows.size(); ++i)
  {
    const Flow& flow = flows[i];
    if (flow.points->size() > 0)
    {
      BatchBuffers& buffers = tasks_->batches[i];
      buffers.fill(*flow.points);
      handles[i] = tasks_->submit(
          tasks_->track_points,
          {Argument::in(*flow.from), Argument::in(*flow.to), Argument::in(buffers.from), Argument::inOut(buffers.to),
           Argument::out(buffers.status), Argument::out(buffers.residual), Argument::value(trackOptions(flow.levels))},
          flow.points->size());
    }
  }
  for (size_t i = 0; i < flows.size(); ++i)
  {
    if (!handles[i].valid())
    {
      continue;
    }
    if (handles[i].wait().ok())
    {
      tasks_->batches[i].read(flows[i].points);
    }
    else
    {
      trackHere(flows[i]);
    }
  }
}

void PictureKernels::findCorners(const Pyramid& pyramid, int threshold, std::vector<kernels::Corner>* corners)
{
  corners->resize(MOST_CORNERS);
  std::optional<size_t> count;
  if (tasks_)
  {
    const kernels::PyramidLevel& level = layout_.level[0];
    const kernels::FastCornersShape shape{level.width, level.height, static_cast<int32_t>(level.stride), threshold,
                                          static_cast<int32_t>(MOST_CORNERS)};
    reserve(&tasks_->corners, MOST_CORNERS * sizeof(kernels::Corner));
    reserve(&tasks_->corner_work, std::max<size_t>(1, kernels::fastCornersWorkBytes(level.width, level.height)));
    const pi_runtime::TaskHandle handle =
        tasks_->submit(tasks_->fast_corners,
                       {Argument::in(pyramid), Argument::out(tasks_->corners), Argument::out(tasks_->corner_count),
                        Argument::out(tasks_->corner_work), Argument::value(shape)},
                       1);
    if (handle.wait().ok())
    {
      count = std::min<size_t>(*tasks_->corner_count->hostAs<uint32_t>(Access::READ), MOST_CORNERS);
      std::memcpy(corners->data(), tasks_->corners->host(Access::READ), *count * sizeof(kernels::Corner));
    }
  }
  if (!count)
  {
    count = kernels::findFastCorners(view(pyramid, 0), threshold, corners->data(), corners->size());
  }
  corners->resize(std::min(*count, MOST_CORNERS));
}

}  // namespace pi_slam::front_end
