#include "detector/ssd_decoder.h"

#include <algorithm>
#include <cstring>

namespace pi_detect
{
namespace
{

using pi_runtime::Argument;
using pi_runtime::Buffer;
using pi_runtime::kernels::SsdDetection;

constexpr size_t MAX_ROWS = 1024;  ///< of a network with DetectionOutput
constexpr size_t DETECTION_COLUMNS = 7;
static_assert(sizeof(SsdDetection) == DETECTION_COLUMNS * sizeof(float), "a row of DetectionOutput");

}  // namespace

DetectionRows::DetectionRows()
  : rows_(Buffer::allocate(MAX_ROWS * sizeof(SsdDetection))), count_(Buffer::allocate(sizeof(int32_t)))
{
}

OutputDecoder::Store DetectionRows::store() const
{
  return [](const std::vector<cv::Mat>& outputs, const pi_runtime::NativeCall& call)
  {
    const size_t rows = std::min<size_t>(outputs[0].total() / DETECTION_COLUMNS, MAX_ROWS);
    std::memcpy(call.buffer<float>(1), outputs[0].ptr<float>(), rows * sizeof(SsdDetection));
    *call.buffer<int32_t>(2) = static_cast<int32_t>(rows);
  };
}

DecodedRows DetectionRows::rows() const
{
  const auto count = static_cast<size_t>(*count_->hostAs<int32_t>(pi_runtime::Access::READ));
  return {rows_->hostAs<SsdDetection>(pi_runtime::Access::READ), count};
}

std::vector<pi_runtime::kernels::SsdPrior> priorsOf(const RawOutputs& raw)
{
  return pi_runtime::kernels::makeSsdPriors(raw.feature_maps, raw.clip_priors);
}

SsdDecoder::SsdDecoder(const RawOutputs& raw, float score_threshold)
{
  const auto priors = priorsOf(raw);
  shape_ = {static_cast<int32_t>(priors.size()),
            raw.classes,
            raw.background,
            raw.top_k,
            raw.keep_top_k,
            score_threshold,
            raw.overlap_threshold,
            raw.activation | pi_runtime::kernels::SSD_CLIP};
  variances_ = {raw.variances[0], raw.variances[1], raw.variances[2], raw.variances[3]};
  boxes_ = Buffer::allocate(priors.size() * 4 * sizeof(float));
  scores_ = Buffer::allocate(priors.size() * static_cast<size_t>(raw.classes) * sizeof(float));
  priors_ = Buffer::allocate(priors.size() * sizeof(priors[0]));
  std::memcpy(priors_->host(pi_runtime::Access::WRITE), priors.data(), priors_->bytes());
  work_ = Buffer::allocate(pi_runtime::kernels::ssdWorkBytes(shape_));
  decoded_ = Buffer::allocate(static_cast<size_t>(raw.keep_top_k) * sizeof(SsdDetection));
  count_ = Buffer::allocate(sizeof(int32_t));
}

OutputDecoder::Store SsdDecoder::store() const
{
  return [](const std::vector<cv::Mat>& outputs, const pi_runtime::NativeCall& call)
  {
    for (size_t i = 0; i < 2; ++i)
    {
      std::memcpy(call.buffer<float>(1 + i), outputs[i].ptr<float>(), call.bufferBytes(1 + i));
    }
  };
}

std::optional<pi_runtime::TaskRequest> SsdDecoder::task() const
{
  pi_runtime::TaskRequest task;
  task.codelet = pi_runtime::kernels::ssdPostprocessCodelet();
  task.arguments = {Argument::in(boxes_),    Argument::in(scores_),      Argument::in(priors_),
                    Argument::out(work_),    Argument::out(decoded_),    Argument::out(count_),
                    Argument::value(shape_), Argument::value(variances_)};
  task.size = static_cast<double>(shape_.priors) * shape_.classes;
  return task;
}

DecodedRows SsdDecoder::rows() const
{
  const auto count = static_cast<size_t>(*count_->hostAs<int32_t>(pi_runtime::Access::READ));
  return {decoded_->hostAs<SsdDetection>(pi_runtime::Access::READ), count};
}

}  // namespace pi_detect
