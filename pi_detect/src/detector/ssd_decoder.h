#pragma once

#include "detector/output_decoder.h"

namespace pi_detect
{

/// OutputKind::DETECTIONS: the network has decoded its outputs itself.
class DetectionRows : public OutputDecoder
{
public:
  DetectionRows();
  std::vector<pi_runtime::BufferPtr> outputs() const override { return {rows_, count_}; }
  Store store() const override;
  std::optional<pi_runtime::TaskRequest> task() const override { return std::nullopt; }
  DecodedRows rows() const override;

private:
  pi_runtime::BufferPtr rows_;
  pi_runtime::BufferPtr count_;
};

/// OutputKind::RAW: box codes and scores per prior (Liu et al. 2016), by pi_runtime's "ssd_postprocess".
class SsdDecoder : public OutputDecoder
{
public:
  SsdDecoder(const RawOutputs& raw, float score_threshold);
  std::vector<pi_runtime::BufferPtr> outputs() const override { return {boxes_, scores_}; }
  Store store() const override;
  std::optional<pi_runtime::TaskRequest> task() const override;
  DecodedRows rows() const override;

private:
  pi_runtime::kernels::SsdShape shape_{};
  pi_runtime::kernels::SsdVariances variances_{};
  pi_runtime::BufferPtr boxes_;
  pi_runtime::BufferPtr scores_;
  pi_runtime::BufferPtr priors_;
  pi_runtime::BufferPtr work_;
  pi_runtime::BufferPtr decoded_;
  pi_runtime::BufferPtr count_;
};

/// Default boxes of a model with raw outputs.
std::vector<pi_runtime::kernels::SsdPrior> priorsOf(const RawOutputs& raw);

}  // namespace pi_detect
