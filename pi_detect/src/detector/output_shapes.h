#pragma once

#include <pi_detect/model_description.h>

#include <optional>
#include <string>
#include <vector>

namespace pi_detect
{

/// Size of a network's output, as rows of its last dimension.
struct OutputShape
{
  std::string name;
  size_t rows = 0;
  size_t columns = 0;
};

/// The kind of outputs that these shapes fit, for the input and labels of a model; nullopt: none.
std::optional<OutputKind> kindOf(const std::vector<OutputShape>& outputs, const ModelDescription& model);

/// "scores 2100 x 80, boxes 2100 x 32"
std::string toString(const std::vector<OutputShape>& outputs);

/// Outputs of kind DISTRIBUTION in the order of the strides, scores before distances, as indices; empty: they do not
/// fit. Names mean nothing: exports mix them up.
std::vector<size_t> orderOfDistributions(const std::vector<OutputShape>& outputs, const ModelDescription& model);

}  // namespace pi_detect
