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

}  // namespace pi_detect
