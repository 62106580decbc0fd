#include <pi_detect/ssd_detector.h>

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pi_runtime/kernels/blob.h>
#include <pi_runtime/kernels/ssd_postprocess.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "detector/network.h"

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
using pi_runtime::kernels::SsdDetection;
using pi_runtime::kernels::SsdShape;
using pi_runtime::kernels::SsdVariances;

constexpr int MAX_ROWS = 1024;  ///< of a network with DetectionOutput
constexpr int MAX_PICTURE = 32767;
constexpr size_t DETECTION_COLUMNS = 7;
static_assert(sizeof(SsdDetection) == DETECTION_COLUMNS * sizeof(float), "a row of DetectionOutput");

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

class SsdDetector::Implementation
{
public:
  Implementation(ModelDescription model, const DetectorOptions& options, std::shared_ptr<pi_runtime::Runtime> runtime);

  DetectionResult detect(const PictureView& picture);

  const ModelDescription model_;
  TargetInUse target_;
  std::string codelet_name_;

private:
  void makeBuffers();
  void adaptTo(const PictureView& picture);
  void runSteps(DetectionResult* result);
  void runTasks(DetectionResult* result);
  pi_runtime::TaskRequest blobTask() const;
  pi_runtime::TaskRequest forwardTask() const;
  pi_runtime::TaskRequest decodeTask() const;
  Detections readDetections(const PictureView& picture) const;

  const std::map<int, float> thresholds_;  ///< by class id; others are not wanted
  const float class_agnostic_overlap_;
  const size_t max_detections_;
  const std::shared_ptr<pi_runtime::Runtime> runtime_;
  std::shared_ptr<Network> network_;  ///< the codelet holds it too: a runtime may keep that longer than this object
  pi_runtime::CodeletPtr forward_codelet_;

  BlobGeometry geometry_{};
  BlobColours colours_{};
  BufferPtr plan_;
  cv::Mat colour_picture_;  ///< of a grey one
  BufferPtr source_;
  BufferPtr blob_;
  BufferPtr boxes_;   ///< RAW: codes; DETECTIONS: rows
  BufferPtr scores_;  ///< RAW: scores; DETECTIONS: the number of rows
  BufferPtr priors_;
  BufferPtr work_;
  BufferPtr decoded_;
  BufferPtr count_;
  SsdShape shape_{};
  SsdVariances variances_{};
};

SsdDetector::Implementation::Implementation(ModelDescription model, const DetectorOptions& options,
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
  if (options.check_model)
  {
    checkModel(model_, options.check);
  }
  else
  {
    checkFiles(model_);
  }
  network_ = std::make_shared<Network>(model_, target_);
  codelet_name_ = "ssd_forward_" + model_.name + "_" + toString(target_.used);
  makeBuffers();
}

void SsdDetector::Implementation::makeBuffers()
{
  const NetworkInput& input = model_.input;
  blob_ = Buffer::allocate(static_cast<size_t>(3 * input.width) * static_cast<size_t>(input.height) * sizeof(float));
  std::copy(input.mean.begin(), input.mean.end(), colours_.mean);
  colours_.scale = input.scale;
  colours_.fill = input.bar_level;
  const bool raw = model_.output_kind == OutputKind::RAW;
  if (raw)
  {
    const RawOutputs& outputs = model_.raw;
    const auto priors = priorsOf(model_);
    float lowest = 1.0F;
    for (const auto& [id, threshold] : thresholds_)
    {
      lowest = std::min(lowest, threshold);
    }
    shape_ = SsdShape{static_cast<int32_t>(priors.size()),
                      outputs.classes,
                      outputs.background,
                      outputs.top_k,
                      outputs.keep_top_k,
                      lowest,
                      outputs.overlap_threshold,
                      outputs.activation | pi_runtime::kernels::SSD_CLIP};
    variances_ = SsdVariances{outputs.variances[0], outputs.variances[1], outputs.variances[2], outputs.variances[3]};
    boxes_ = Buffer::allocate(priors.size() * 4 * sizeof(float));
    scores_ = Buffer::allocate(priors.size() * static_cast<size_t>(outputs.classes) * sizeof(float));
    priors_ = Buffer::allocate(priors.size() * sizeof(priors[0]));
    std::memcpy(priors_->host(pi_runtime::Access::WRITE), priors.data(), priors_->bytes());
    work_ = Buffer::allocate(pi_runtime::kernels::ssdWorkBytes(shape_));
    decoded_ = Buffer::allocate(static_cast<size_t>(outputs.keep_top_k) * sizeof(SsdDetection));
    count_ = Buffer::allocate(sizeof(int32_t));
  }
  else
  {
    boxes_ = Buffer::allocate(MAX_ROWS * sizeof(SsdDetection));
    scores_ = Buffer::allocate(sizeof(int32_t));
  }

  pi_runtime::Codelet codelet;
  codelet.name = codelet_name_;
  pi_runtime::NativeImplementation implementation;
  implementation.function = [network = network_, raw](const pi_runtime::NativeCall& call)
  {
    const std::vector<cv::Mat>& outputs = network->forward(call.buffer<const float>(0));
    if (raw)
    {
      for (size_t i = 0; i < 2; ++i)
      {
        std::memcpy(call.buffer<float>(1 + i), outputs[i].ptr<float>(), call.bufferBytes(1 + i));
      }
      return;
    }
    const size_t rows = std::min<size_t>(outputs[0].total() / DETECTION_COLUMNS, MAX_ROWS);
    std::memcpy(call.buffer<float>(1), outputs[0].ptr<float>(), rows * sizeof(SsdDetection));
    *call.buffer<int32_t>(2) = static_cast<int32_t>(rows);
  };
  const auto units = runtime_ == nullptr ? std::vector<pi_runtime::UnitStatus>() : runtime_->units();
  const bool on_gpu = target_.gpu && std::any_of(units.begin(), units.end(),
                                                 [](const pi_runtime::UnitStatus& unit)
                                                 { return unit.type == pi_runtime::UnitType::GPU; });
  implementation.unit_types = static_cast<uint8_t>(on_gpu ? pi_runtime::UnitType::GPU : pi_runtime::UnitType::CPU);
  codelet.native = {std::move(implementation)};
  forward_codelet_ = pi_runtime::makeCodelet(std::move(codelet));
}

void SsdDetector::Implementation::adaptTo(const PictureView& picture)
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
  geometry.letterbox = model_.input.letterbox ? 1 : 0;
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

pi_runtime::TaskRequest SsdDetector::Implementation::blobTask() const
{
  pi_runtime::TaskRequest task;
  task.codelet = pi_runtime::kernels::blobCodelet();
  task.arguments = {Argument::in(source_), Argument::in(plan_), Argument::out(blob_), Argument::value(geometry_),
                    Argument::value(colours_)};
  task.range = static_cast<uint64_t>(geometry_.height);
  task.size = static_cast<double>(geometry_.height) * geometry_.width;
  return task;
}

pi_runtime::TaskRequest SsdDetector::Implementation::forwardTask() const
{
  pi_runtime::TaskRequest task;
  task.codelet = forward_codelet_;
  task.arguments = {Argument::in(blob_), Argument::out(boxes_), Argument::out(scores_)};
  return task;
}

pi_runtime::TaskRequest SsdDetector::Implementation::decodeTask() const
{
  pi_runtime::TaskRequest task;
  task.codelet = pi_runtime::kernels::ssdPostprocessCodelet();
  task.arguments = {Argument::in(boxes_),    Argument::in(scores_),      Argument::in(priors_),
                    Argument::out(work_),    Argument::out(decoded_),    Argument::out(count_),
                    Argument::value(shape_), Argument::value(variances_)};
  task.size = static_cast<double>(shape_.priors) * shape_.classes;
  return task;
}

void SsdDetector::Implementation::runTasks(DetectionResult* result)
{
  pi_runtime::GraphRequest graph;
  graph.tasks = {blobTask(), forwardTask()};
  graph.edges = {{0, 1, static_cast<double>(blob_->bytes())}};
  if (model_.output_kind == OutputKind::RAW)
  {
    graph.tasks.push_back(decodeTask());
    graph.edges.push_back({1, 2, static_cast<double>(boxes_->bytes() + scores_->bytes())});
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
      throw std::runtime_error(codelet_name_ + ": " + toString(task.outcome) + ": " + task.message);
    }
    *seconds[i] = pi_node::secondsBetween(task.started_ns, task.finished_ns);
  }
  result->unit = handles[1].wait().unit;
}

void SsdDetector::Implementation::runSteps(DetectionResult* result)
{
  const auto run = [](const pi_runtime::TaskRequest& task, double* seconds)
  {
    const auto start = std::chrono::steady_clock::now();
    task.codelet->native[0].function(pi_runtime::NativeCall(task.arguments, 0, task.range, task.range, nullptr));
    *seconds = pi_node::secondsSince(start);
  };
  run(blobTask(), &result->blob_s);
  run(forwardTask(), &result->forward_s);
  if (model_.output_kind == OutputKind::RAW)
  {
    run(decodeTask(), &result->decode_s);
  }
}

Detections SsdDetector::Implementation::readDetections(const PictureView& picture) const
{
  const bool raw = model_.output_kind == OutputKind::RAW;
  const auto count = static_cast<size_t>(*(raw ? count_ : scores_)->hostAs<int32_t>(pi_runtime::Access::READ));
  const auto* rows = (raw ? decoded_ : boxes_)->hostAs<SsdDetection>(pi_runtime::Access::READ);
  const BlobContent content = blobContent(geometry_);
  const auto width = static_cast<float>(picture.width);
  const auto height = static_cast<float>(picture.height);
  // From parts of the input to pixels of the picture.
  const auto toX = [&](float x)
  {
    return (x * static_cast<float>(geometry_.width) - static_cast<float>(content.x)) * width /
           static_cast<float>(content.width);
  };
  const auto toY = [&](float y)
  {
    return (y * static_cast<float>(geometry_.height) - static_cast<float>(content.y)) * height /
           static_cast<float>(content.height);
  };
  Detections detections;
  for (size_t i = 0; i < count; ++i)
  {
    const SsdDetection& row = rows[i];
    const auto threshold = thresholds_.find(static_cast<int>(std::lround(row.class_id)));
    if (threshold == thresholds_.end() || !(row.score >= threshold->second))
    {
      continue;
    }
    Detection detection;
    detection.class_id = threshold->first;
    detection.score = row.score;
    detection.box = Box{std::clamp(toX(row.x1), 0.0F, width), std::clamp(toY(row.y1), 0.0F, height),
                        std::clamp(toX(row.x2), 0.0F, width), std::clamp(toY(row.y2), 0.0F, height)};
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

DetectionResult SsdDetector::Implementation::detect(const PictureView& picture)
{
  adaptTo(picture);
  DetectionResult result;
  if (runtime_ != nullptr)
  {
    runTasks(&result);
  }
  else
  {
    runSteps(&result);
  }
  const auto start = std::chrono::steady_clock::now();
  result.detections = readDetections(picture);
  result.decode_s += pi_node::secondsSince(start);
  source_.reset();
  return result;
}

SsdDetector::SsdDetector(const ModelDescription& model, const DetectorOptions& options,
                         std::shared_ptr<pi_runtime::Runtime> runtime)
  : implementation_(std::make_unique<Implementation>(model, options, std::move(runtime)))
{
}

SsdDetector::~SsdDetector() = default;

DetectionResult SsdDetector::detect(const PictureView& picture)
{
  return implementation_->detect(picture);
}

const ModelDescription& SsdDetector::model() const
{
  return implementation_->model_;
}

const TargetInUse& SsdDetector::target() const
{
  return implementation_->target_;
}

const std::string& SsdDetector::codeletName() const
{
  return implementation_->codelet_name_;
}

}  // namespace pi_detect
