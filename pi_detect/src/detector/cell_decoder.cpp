#include "detector/cell_decoder.h"

#include <pi_detect/detection.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>

namespace pi_detect
{
namespace
{

using pi_runtime::Argument;
using pi_runtime::Buffer;

constexpr size_t GRID_BOX_COLUMNS = 4;  ///< x, y, width, height; then the objectness
constexpr size_t SIDES = 4;             ///< left, top, right, bottom

float sigmoid(float value)
{
  return 1.0F / (1.0F + std::exp(-value));
}

float identity(float value)
{
  return value;
}

size_t columnsOf(const ModelDescription& model)
{
  const auto classes = static_cast<size_t>(model.cells.classes);
  return model.output_kind == OutputKind::GRID ? GRID_BOX_COLUMNS + 1 + classes
                                               : classes + SIDES * static_cast<size_t>(model.cells.bins);
}

/// A place in the feature maps.
struct Cell
{
  int column;
  int row;
  int stride;
};

/// Where each cell lies, in the order of the outputs.
std::vector<Cell> makeCells(const NetworkInput& input, const std::vector<int>& strides)
{
  std::vector<Cell> cells;
  for (const int stride : strides)
  {
    for (int row = 0; row * stride < input.height; ++row)
    {
      for (int column = 0; column * stride < input.width; ++column)
      {
        cells.push_back({column, row, stride});
      }
    }
  }
  return cells;
}

/// Expectation of the softmax over bins 0, 1, ...
float expectation(const float* values, int bins)
{
  const float highest = *std::max_element(values, values + bins);
  float sum = 0.0F;
  float weighted = 0.0F;
  for (int i = 0; i < bins; ++i)
  {
    const float weight = std::exp(values[i] - highest);
    sum += weight;
    weighted += weight * static_cast<float>(i);
  }
  return weighted / sum;
}

/// A cell whose best class scores enough.
struct Candidate
{
  float score;
  int class_id;
  size_t cell;
};

class CellDecoding
{
public:
  CellDecoding(const ModelDescription& model, float score_threshold)
    : is_grid_(model.output_kind == OutputKind::GRID)
    , shape_(model.cells)
    , width_(static_cast<float>(model.input.width))
    , height_(static_cast<float>(model.input.height))
    , score_threshold_(score_threshold)
    , columns_(columnsOf(model))
    , cells_(makeCells(model.input, model.cells.strides))
  {
  }

  /// @return number of rows made.
  size_t run(const float* outputs, DecodedRow* rows) const
  {
    std::vector<Candidate> candidates = shape_.sigmoid ? collect(outputs, sigmoid) : collect(outputs, identity);
    const auto better = [](const Candidate& a, const Candidate& b)
    { return a.score > b.score || (a.score == b.score && a.cell < b.cell); };
    const size_t most = std::min(candidates.size(), static_cast<size_t>(shape_.top_k));
    std::partial_sort(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(most), candidates.end(),
                      better);
    candidates.resize(most);
    std::vector<std::pair<int, Box>> kept;
    for (const Candidate& candidate : candidates)
    {
      if (kept.size() == static_cast<size_t>(shape_.keep_top_k))
      {
        break;
      }
      const float* const values = outputs + candidate.cell * columns_;
      const Box box = is_grid_ ? gridBox(values, cells_[candidate.cell])
                               : distributionBox(values + shape_.classes, cells_[candidate.cell]);
      const bool suppressed = std::any_of(
          kept.begin(), kept.end(),
          [&](const std::pair<int, Box>& other)
          { return other.first == candidate.class_id && overlap(other.second, box) > shape_.overlap_threshold; });
      if (!suppressed)
      {
        rows[kept.size()] = {0.0F,
                             static_cast<float>(candidate.class_id),
                             candidate.score,
                             box.x1 / width_,
                             box.y1 / height_,
                             box.x2 / width_,
                             box.y2 / height_};
        kept.emplace_back(candidate.class_id, box);
      }
    }
    return kept.size();
  }

private:
  template <typename Activation>
  std::vector<Candidate> collect(const float* outputs, Activation activation) const
  {
    std::vector<Candidate> candidates;
    for (size_t cell = 0; cell < cells_.size(); ++cell)
    {
      const float* const values = outputs + cell * columns_;
      const float objectness = is_grid_ ? activation(values[GRID_BOX_COLUMNS]) : 1.0F;
      if (!(objectness >= score_threshold_))  // a score is at most the objectness
      {
        continue;
      }
      const float* const scores = is_grid_ ? values + GRID_BOX_COLUMNS + 1 : values;
      const float* const best = std::max_element(scores, scores + shape_.classes);
      const float score = objectness * activation(*best);
      if (score >= score_threshold_)
      {
        candidates.push_back({score, static_cast<int>(best - scores), cell});
      }
    }
    return candidates;
  }

  Box gridBox(const float* values, const Cell& cell) const
  {
    const auto stride = static_cast<float>(cell.stride);
    const float x = (static_cast<float>(cell.column) + shape_.offset + values[0]) * stride;
    const float y = (static_cast<float>(cell.row) + shape_.offset + values[1]) * stride;
    const float half_width = 0.5F * stride * std::exp(values[2]);
    const float half_height = 0.5F * stride * std::exp(values[3]);
    return {x - half_width, y - half_height, x + half_width, y + half_height};
  }

  Box distributionBox(const float* values, const Cell& cell) const
  {
    const auto stride = static_cast<float>(cell.stride);
    const float x = (static_cast<float>(cell.column) + shape_.offset) * stride;
    const float y = (static_cast<float>(cell.row) + shape_.offset) * stride;
    std::array<float, SIDES> distance{};
    for (size_t side = 0; side < SIDES; ++side)
    {
      distance[side] = stride * expectation(values + side * static_cast<size_t>(shape_.bins), shape_.bins);
    }
    return {x - distance[0], y - distance[1], x + distance[2], y + distance[3]};
  }

  const bool is_grid_;
  const CellOutputs shape_;
  const float width_;   ///< of the input [px]
  const float height_;  ///< likewise
  const float score_threshold_;
  const size_t columns_;  ///< of a cell
  const std::vector<Cell> cells_;
};

}  // namespace

size_t cellsOf(const NetworkInput& input, const std::vector<int>& strides)
{
  return makeCells(input, strides).size();
}

CellDecoder::CellDecoder(const ModelDescription& model, float score_threshold)
  : columns_(columnsOf(model))
  , outputs_(Buffer::allocate(cellsOf(model.input, model.cells.strides) * columns_ * sizeof(float)))
  , decoded_(Buffer::allocate(static_cast<size_t>(model.cells.keep_top_k) * sizeof(DecodedRow)))
  , count_(Buffer::allocate(sizeof(int32_t)))
{
  pi_runtime::Codelet codelet;
  codelet.name = "decode_" + model.name;
  pi_runtime::NativeImplementation implementation;
  implementation.function = [decoding = CellDecoding(model, score_threshold)](const pi_runtime::NativeCall& call)
  {
    const size_t count = decoding.run(call.buffer<const float>(0), call.buffer<DecodedRow>(1));
    *call.buffer<int32_t>(2) = static_cast<int32_t>(count);
  };
  codelet.native = {std::move(implementation)};
  codelet_ = pi_runtime::makeCodelet(std::move(codelet));
}

OutputDecoder::Store CellDecoder::store() const
{
  // One output has all columns; otherwise scores and distances of each stride follow each other.
  return [columns = columns_](const std::vector<cv::Mat>& outputs, const pi_runtime::NativeCall& call)
  {
    float* to = call.buffer<float>(1);
    if (outputs.size() == 1)
    {
      std::memcpy(to, outputs[0].ptr<float>(), call.bufferBytes(1));
      return;
    }
    for (size_t i = 0; i + 1 < outputs.size(); i += 2)
    {
      const auto scores = static_cast<size_t>(outputs[i].size[outputs[i].dims - 1]);
      const float* from_scores = outputs[i].ptr<float>();
      const float* from_boxes = outputs[i + 1].ptr<float>();
      for (size_t cell = 0; cell < outputs[i].total() / scores; ++cell)
      {
        to = std::copy_n(from_scores, scores, to);
        to = std::copy_n(from_boxes, columns - scores, to);
        from_scores += scores;
        from_boxes += columns - scores;
      }
    }
  };
}

std::optional<pi_runtime::TaskRequest> CellDecoder::task() const
{
  pi_runtime::TaskRequest task;
  task.codelet = codelet_;
  task.arguments = {Argument::in(outputs_), Argument::out(decoded_), Argument::out(count_)};
  return task;
}

DecodedRows CellDecoder::rows() const
{
  const auto count = static_cast<size_t>(*count_->hostAs<int32_t>(pi_runtime::Access::READ));
  return {decoded_->hostAs<DecodedRow>(pi_runtime::Access::READ), count};
}

}  // namespace pi_detect
