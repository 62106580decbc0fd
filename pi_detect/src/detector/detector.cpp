#include <pi_detect/detector.h>

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_runtime/kernels/blob.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "detector/network.h"
#include "detector/output_decoder.h"
#include "detector/stage_threads.h"

namespace pi_detect
{
namespace
{

using pi_runtime::Argument;
using pi_runtime::Buffer;
using pi_runtime::BufferPtr;
using pi_runtime::kernels::BlobColours;
using pi_runtime::kernels::BlobContent;
using pi_runtime::kernels::BlobGeometry;

constexpr int MAX_PICTURE = 32767;
constexpr char STAGE[] = "detection";

int32_t blobFit(InputFit fit)
{
  switch (fit)
  {
    case InputFit::LETTERBOX:
      return pi_runtime::kernels::BLOB_CENTRED;
    case InputFit::LETTERBOX_TOP_LEFT:
      return pi_runtime::kernels::BLOB_AT_TOP_LEFT;
    case InputFit::STRETCH:
      break;
  }
  return pi_runtime::kernels::BLOB_STRETCHED;
}

/// From parts of the network's input to pixels of the picture, inside it.
class ToPicture
{
public:
  explicit ToPicture(const BlobGeometry& geometry)
    : content_(blobContent(geometry))
    , input_width_(static_cast<float>(geometry.width))
    , input_height_(static_cast<float>(geometry.height))
    , width_(static_cast<float>(geometry.source_width))
    , height_(static_cast<float>(geometry.source_height))
    , scale_x_(width_ / static_cast<float>(content_.width))
    , scale_y_(height_ / static_cast<float>(content_.height))
  {
    if (geometry.letterbox == pi_runtime::kernels::BLOB_AT_TOP_LEFT)  // one scale for both, as YOLOX's own code has it
    {
      scale_x_ = scale_y_ = std::max(width_ / input_width_, height_ / input_height_);
    }
  }

  Box box(const DecodedRow& row) const { return {x(row.x1), y(row.y1), x(row.x2), y(row.y2)}; }

private:
  float x(float part) const
  {
    return std::clamp((part * input_width_ - static_cast<float>(content_.x)) * scale_x_, 0.0F, width_);
  }
  float y(float part) const
  {
    return std::clamp((part * input_height_ - static_cast<float>(content_.y)) * scale_y_, 0.0F, height_);
  }

  const BlobContent content_;
  const float input_width_;
  const float input_height_;
  const float width_;
  const float height_;
  float scale_x_;
  float scale_y_;
};

}  // namespace

void DetectorOptions::validate() const
{
  const pi_node::OptionCheck options("");
  options.range("threads", threads, 0, 256);
  const pi_node::OptionCheck checking("check");
  checking.range("timeout_s", check.timeout_s, 0.001, 3600.0);
  checking.range("memory_limit_mb", check.memory_limit_mb, 256, 1 << 20);
  filter.validate();
}

class Detector::Implementation
{
public:
  Implementation(ModelDescription model, const DetectorOptions& options, std::shared_ptr<pi_runtime::Runtime> runtime);

  DetectionResult detect(const PictureView& picture);

  pi_runtime::StageStatus stage() const;

  const ModelDescription model_;
  TargetInUse target_;

private:
  void makeBuffers();
  void adaptTo(const PictureView& picture);
  void runSteps(DetectionResult* result);
  void runTasks(DetectionResult* result);
  pi_runtime::TaskRequest blobTask() const;
  pi_runtime::TaskRequest forwardTask() const;
  Detections readDetections() const;

  const std::map<int, float> thresholds_;  ///< by class id; others are not wanted
  const float class_agnostic_overlap_;
  const size_t max_detections_;
  std::shared_ptr<pi_runtime::Runtime> runtime_;  ///< for tasks; null: a stage, or plain calls
  std::unique_ptr<pi_runtime::Stage> stage_;
  std::shared_ptr<Network> network_;  ///< the codelet holds it too: a runtime may keep that longer than this object
  pi_runtime::CodeletPtr forward_codelet_;

  BlobGeometry geometry_{};
  BlobColours colours_{};
  BufferPtr plan_;
  cv::Mat colour_picture_;  ///< of a grey one
  BufferPtr source_;
  BufferPtr blob_;
  std::unique_ptr<OutputDecoder> decoder_;
};

Detector::Implementation::Implementation(ModelDescription model, const DetectorOptions& options,
                                         std::shared_ptr<pi_runtime::Runtime> runtime)
  : model_(std::move(model))
  , thresholds_((options.validate(), model_.validate(), options.filter.thresholds(model_)))
  , class_agnostic_overlap_(options.filter.class_agnostic_overlap < 0.0F ? model_.class_agnostic_overlap
                                                                         : options.filter.class_agnostic_overlap)
  , max_detections_(static_cast<size_t>(options.filter.max_detections))
  , runtime_(std::move(runtime))
{
  target_ = findTarget(options.target);
  if (options.require_target && target_.used != target_.requested)
  {
    throw ModelError(std::string("target ") + toString(target_.requested) + " cannot be had: " + target_.reason);
  }
  if (options.threads > 0)
  {
    cv::setNumThreads(options.threads);
  }
  if (runtime_)
  {
    cutStages(*runtime_, options.threads);
  }
  if (options.check_model)
  {
    checkModel(model_, options.check);
  }
  else
  {
    checkFiles(model_);
  }
  network_ = std::make_shared<Network>(model_, target_);
  makeBuffers();
  if (target_.used == Target::CPU || !runtime_)
  {
    stage_ = std::make_unique<pi_runtime::Stage>(std::exchange(runtime_, nullptr), pi_runtime::StageOptions{STAGE});
  }
}

void Detector::Implementation::makeBuffers()
{
  const NetworkInput& input = model_.input;
  blob_ = Buffer::allocate(static_cast<size_t>(3 * input.width) * static_cast<size_t>(input.height) * sizeof(float));
  std::copy(input.mean.begin(), input.mean.end(), colours_.mean);
  std::copy(input.scale.begin(), input.scale.end(), colours_.scale);
  colours_.fill = input.bar_level;
  float lowest = 1.0F;
  for (const auto& [id, threshold] : thresholds_)
  {
    lowest = std::min(lowest, threshold);
  }
  decoder_ = makeOutputDecoder(model_, lowest);

  pi_runtime::Codelet codelet;
  codelet.name = "network_" + model_.name + "_" + toString(target_.used);
  pi_runtime::NativeImplementation implementation;
  implementation.function = [network = network_, store = decoder_->store()](const pi_runtime::NativeCall& call)
  { store(network->forward(call.buffer<const float>(0)), call); };
  const auto units = runtime_ == nullptr ? std::vector<pi_runtime::UnitStatus>() : runtime_->units();
  const bool on_gpu = target_.gpu && std::any_of(units.begin(), units.end(),
                                                 [](const pi_runtime::UnitStatus& unit)
                                                 { return unit.type == pi_runtime::UnitType::GPU; });
  implementation.unit_types = static_cast<uint8_t>(on_gpu ? pi_runtime::UnitType::GPU : pi_runtime::UnitType::CPU);
  codelet.native = {std::move(implementation)};
  forward_codelet_ = pi_runtime::makeCodelet(std::move(codelet));
}

void Detector::Implementation::adaptTo(const PictureView& picture)
{
  if (picture.data == nullptr || picture.width < 2 || picture.height < 2 || picture.width > MAX_PICTURE ||
      picture.height > MAX_PICTURE)
  {
    throw std::invalid_argument("picture of " + std::to_string(picture.width) + " x " + std::to_string(picture.height) +
                                " pixels: must be from 2 x 2 to 32767 x 32767, with data");
  }
  const bool grey = picture.format == PictureView::Format::MONO8;
  const size_t bytes_per_pixel = grey ? 1 : 3;
  if (picture.stride < static_cast<size_t>(picture.width) * bytes_per_pixel)
  {
    throw std::invalid_argument("picture: " + std::to_string(picture.stride) + " bytes per row are fewer than " +
                                std::to_string(picture.width) + " pixels take");
  }
  const uint8_t* data = picture.data;
  size_t stride = picture.stride;
  if (grey)
  {
    const cv::Mat view(picture.height, picture.width, CV_8UC1, const_cast<uint8_t*>(data), stride);
    cv::cvtColor(view, colour_picture_, cv::COLOR_GRAY2BGR);
    data = colour_picture_.data;
    stride = colour_picture_.step;
  }
  BlobGeometry geometry{};
  geometry.source_width = picture.width;
  geometry.source_height = picture.height;
  geometry.source_stride = static_cast<int32_t>(stride);
  geometry.channels = 3;
  geometry.width = model_.input.width;
  geometry.height = model_.input.height;
  geometry.letterbox = blobFit(model_.input.fit);
  if (plan_ == nullptr || std::memcmp(&geometry, &geometry_, sizeof(geometry)) != 0)
  {
    plan_ = pi_runtime::kernels::makeBlobPlan(geometry);
    geometry_ = geometry;
  }
  colours_.swap_rb = (picture.format == PictureView::Format::RGB8) != model_.input.rgb ? 1 : 0;
  // The last row may end before its stride does.
  const size_t bytes = stride * static_cast<size_t>(picture.height - 1) + static_cast<size_t>(picture.width) * 3;
  source_ = Buffer::wrap(static_cast<const void*>(data), bytes);
}

pi_runtime::TaskRequest Detector::Implementation::blobTask() const
{
  pi_runtime::TaskRequest task;
  task.codelet = pi_runtime::kernels::blobCodelet();
  task.arguments = {Argument::in(source_), Argument::in(plan_), Argument::out(blob_), Argument::value(geometry_),
                    Argument::value(colours_)};
  task.range = static_cast<uint64_t>(geometry_.height);
  task.size = static_cast<double>(geometry_.height) * geometry_.width;
  return task;
}

pi_runtime::TaskRequest Detector::Implementation::forwardTask() const
{
  pi_runtime::TaskRequest task;
  task.codelet = forward_codelet_;
  task.arguments = {Argument::in(blob_)};
  for (const BufferPtr& output : decoder_->outputs())
  {
    task.arguments.push_back(Argument::out(output));
  }
  return task;
}

void Detector::Implementation::runTasks(DetectionResult* result)
{
  pi_runtime::GraphRequest graph;
  graph.tasks = {blobTask(), forwardTask()};
  graph.edges = {{0, 1, static_cast<double>(blob_->bytes())}};
  if (auto decoding = decoder_->task())
  {
    double bytes = 0.0;
    for (const BufferPtr& output : decoder_->outputs())
    {
      bytes += static_cast<double>(output->bytes());
    }
    graph.tasks.push_back(std::move(*decoding));
    graph.edges.push_back({1, 2, bytes});
  }
  double* seconds[] = {&result->blob_s, &result->forward_s, &result->decode_s};
  const std::vector<pi_runtime::TaskHandle> handles = runtime_->submitGraph(std::move(graph));
  for (const pi_runtime::TaskHandle& handle : handles)
  {
    handle.wait();  // all of them end, well or not: none may use the picture after this
  }
  for (size_t i = 0; i < handles.size(); ++i)
  {
    const pi_runtime::TaskResult& task = handles[i].wait();
    if (!task.ok())
    {
      throw std::runtime_error(forward_codelet_->name + ": " + toString(task.outcome) + ": " + task.message);
    }
    *seconds[i] = pi_node::secondsBetween(task.started_ns, task.finished_ns);
  }
}

void Detector::Implementation::runSteps(DetectionResult* result)
{
  const auto run = [](const pi_runtime::TaskRequest& task, double* seconds)
  {
    const auto start = std::chrono::steady_clock::now();
    task.codelet->native[0].function(pi_runtime::NativeCall(task.arguments, 0, task.range, task.range, nullptr));
    *seconds = pi_node::secondsSince(start);
  };
  stage_->run(
      [&]
      {
        run(blobTask(), &result->blob_s);
        pi_runtime::Stage::yield();
        run(forwardTask(), &result->forward_s);
        pi_runtime::Stage::yield();
        if (const auto decoding = decoder_->task())
        {
          run(*decoding, &result->decode_s);
        }
      });
}

pi_runtime::StageStatus Detector::Implementation::stage() const
{
  return stage_ ? stage_->status() : pi_runtime::StageStatus();
}

Detections Detector::Implementation::readDetections() const
{
  const DecodedRows rows = decoder_->rows();
  const ToPicture to_picture(geometry_);
  Detections detections;
  for (size_t i = 0; i < rows.count; ++i)
  {
    const DecodedRow& row = rows.first[i];
    const auto threshold = thresholds_.find(static_cast<int>(std::lround(row.class_id)));
    if (threshold == thresholds_.end() || !(row.score >= threshold->second))
    {
      continue;
    }
    const Detection detection{threshold->first, row.score, to_picture.box(row)};
    if (detection.box.area() > 0.0F)  // false for what is not a number, too
    {
      detections.push_back(detection);
    }
  }
  if (class_agnostic_overlap_ > 0.0F)
  {
    suppressAcrossClasses(class_agnostic_overlap_, &detections);
  }
  std::stable_sort(detections.begin(), detections.end(),
                   [](const Detection& a, const Detection& b) { return a.score > b.score; });
  detections.resize(std::min(detections.size(), max_detections_));
  return detections;
}

DetectionResult Detector::Implementation::detect(const PictureView& picture)
{
  adaptTo(picture);
  DetectionResult result;
  if (stage_)
  {
    runSteps(&result);
  }
  else
  {
    runTasks(&result);
  }
  const auto start = std::chrono::steady_clock::now();
  result.detections = readDetections();
  result.decode_s += pi_node::secondsSince(start);
  source_.reset();
  return result;
}

Detector::Detector(const ModelDescription& model, const DetectorOptions& options,
                   std::shared_ptr<pi_runtime::Runtime> runtime)
  : implementation_(std::make_unique<Implementation>(model, options, std::move(runtime)))
{
}

Detector::~Detector() = default;

DetectionResult Detector::detect(const PictureView& picture)
{
  return implementation_->detect(picture);
}

const ModelDescription& Detector::model() const
{
  return implementation_->model_;
}

const TargetInUse& Detector::target() const
{
  return implementation_->target_;
}

pi_runtime::StageStatus Detector::stage() const
{
  return implementation_->stage();
}

}  // namespace pi_detect
