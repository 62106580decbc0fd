#include "detector/output_decoder.h"

#include "detector/cell_decoder.h"
#include "detector/detection_rows.h"

namespace pi_detect
{

std::unique_ptr<OutputDecoder> makeOutputDecoder(const ModelDescription& model, float score_threshold)
{
  switch (model.output_kind)
  {
    case OutputKind::DETECTIONS:
      return std::make_unique<DetectionRows>();
    case OutputKind::GRID:
    case OutputKind::DISTRIBUTION:
      break;
  }
  return std::make_unique<CellDecoder>(model, score_threshold);
}

}  // namespace pi_detect
