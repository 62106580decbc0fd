#include "detector/output_shapes.h"

#include <algorithm>

#include "detector/cell_decoder.h"

namespace pi_detect
{
namespace
{

constexpr size_t DETECTION_ROW = 7;  ///< columns of DetectionOutput
constexpr size_t BOX_CODE = 4;
constexpr size_t BOX_AND_OBJECTNESS = 5;

/// Number of classes by the labels, where nothing else tells.
size_t classesOf(const ModelDescription& model)
{
  return model.labels.empty() ? 0 : static_cast<size_t>(model.labels.rbegin()->first) + 1;
}

/// The model with other outputs, whose strides and bins are the usual ones unless the description has its own.
ModelDescription as(OutputKind kind, const ModelDescription& model)
{
  ModelDescription other = model;
  if (model.output_kind != kind)
  {
    other.output_kind = kind;
    other.cells.classes = static_cast<int>(classesOf(model));
  }
  return other;
}

bool isGrid(const std::vector<OutputShape>& outputs, const ModelDescription& model)
{
  return outputs.size() == 1 && outputs[0].rows == cellsOf(model.input, model.cells.strides) &&
         outputs[0].columns == BOX_AND_OBJECTNESS + static_cast<size_t>(model.cells.classes);
}

/// Whether the number of distances is 4 times some number of bins, which the description may state wrongly.
bool isDistribution(const std::vector<OutputShape>& outputs, ModelDescription model)
{
  const auto classes = static_cast<size_t>(model.cells.classes);
  for (const OutputShape& output : outputs)
  {
    const size_t distances = outputs.size() == 1 ? output.columns - std::min(output.columns, classes) : output.columns;
    if (distances != classes && distances % BOX_CODE == 0 && distances > BOX_CODE)
    {
      model.cells.bins = static_cast<int>(distances / BOX_CODE);
      return !orderOfDistributions(outputs, model).empty();
    }
  }
  return false;
}

}  // namespace

std::optional<OutputKind> kindOf(const std::vector<OutputShape>& outputs, const ModelDescription& model)
{
  if (isGrid(outputs, as(OutputKind::GRID, model)))
  {
    return OutputKind::GRID;
  }
  if (isDistribution(outputs, as(OutputKind::DISTRIBUTION, model)))
  {
    return OutputKind::DISTRIBUTION;
  }
  if (outputs.size() == 1 && outputs[0].columns == DETECTION_ROW)
  {
    return OutputKind::DETECTIONS;
  }
  return std::nullopt;
}

std::string toString(const std::vector<OutputShape>& outputs)
{
  std::string text;
  for (const OutputShape& output : outputs)
  {
    text += (text.empty() ? "" : ", ") + output.name + " " + std::to_string(output.rows) + " x " +
            std::to_string(output.columns);
  }
  return text.empty() ? "nothing" : text;
}

std::vector<size_t> orderOfDistributions(const std::vector<OutputShape>& outputs, const ModelDescription& model)
{
  const auto classes = static_cast<size_t>(model.cells.classes);
  const size_t distances = BOX_CODE * static_cast<size_t>(model.cells.bins);
  if (outputs.size() == 1)
  {
    const bool fits =
        outputs[0].rows == cellsOf(model.input, model.cells.strides) && outputs[0].columns == classes + distances;
    return fits ? std::vector<size_t>{0} : std::vector<size_t>{};
  }
  std::vector<size_t> order;
  for (const int stride : model.cells.strides)
  {
    const size_t cells = cellsOf(model.input, {stride});
    for (const size_t columns : {classes, distances})
    {
      // Where classes and distances are equally many, the first output of that shape is the scores.
      const auto found = std::find_if(outputs.begin(), outputs.end(),
                                      [&](const OutputShape& output)
                                      {
                                        const auto index = static_cast<size_t>(&output - outputs.data());
                                        return output.rows == cells && output.columns == columns &&
                                               std::find(order.begin(), order.end(), index) == order.end();
                                      });
      if (found == outputs.end())
      {
        return {};
      }
      order.push_back(static_cast<size_t>(found - outputs.begin()));
    }
  }
  return order.size() == outputs.size() ? order : std::vector<size_t>{};
}

}  // namespace pi_detect
