#pragma once

#include "detector/output_decoder.h"

namespace pi_detect
{

/// Number of cells of all feature maps: per stride, the input's sides over the stride, rounded up.
size_t cellsOf(const NetworkInput& input, const std::vector<int>& strides);

/// OutputKind::GRID and DISTRIBUTION: see CellOutputs.
class CellDecoder : public OutputDecoder
{
public:
  CellDecoder(const ModelDescription& model, float score_threshold);
  std::vector<pi_runtime::BufferPtr> outputs() const override { return {outputs_}; }
  Store store() const override;
  std::optional<pi_runtime::TaskRequest> task() const override;
  DecodedRows rows() const override;

private:
  const size_t columns_;           ///< of a cell
  pi_runtime::BufferPtr outputs_;  ///< cells x columns
  pi_runtime::BufferPtr decoded_;
  pi_runtime::BufferPtr count_;
  pi_runtime::CodeletPtr codelet_;
};

}  // namespace pi_detect
