#include "detector/detection_rows.h"

#include <algorithm>
#include <cstring>

namespace pi_detect
{
namespace
{

using pi_runtime::Buffer;

constexpr size_t MAX_ROWS = 1024;  ///< of a network with DetectionOutput
constexpr size_t DETECTION_COLUMNS = 7;
static_assert(sizeof(DecodedRow) == DETECTION_COLUMNS * sizeof(float), "a row of DetectionOutput");

}  // namespace

DetectionRows::DetectionRows()
  : rows_(Buffer::allocate(MAX_ROWS * sizeof(DecodedRow))), count_(Buffer::allocate(sizeof(int32_t)))
{
}

OutputDecoder::Store DetectionRows::store() const
{
  return [](const std::vector<cv::Mat>& outputs, const pi_runtime::NativeCall& call)
  {
    const size_t rows = std::min<size_t>(outputs[0].total() / DETECTION_COLUMNS, MAX_ROWS);
    std::memcpy(call.buffer<float>(1), outputs[0].ptr<float>(), rows * sizeof(DecodedRow));
    *call.buffer<int32_t>(2) = static_cast<int32_t>(rows);
  };
}

DecodedRows DetectionRows::rows() const
{
  const auto count = static_cast<size_t>(*count_->hostAs<int32_t>(pi_runtime::Access::READ));
  return {rows_->hostAs<DecodedRow>(pi_runtime::Access::READ), count};
}

}  // namespace pi_detect
