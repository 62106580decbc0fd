#include "tiny_network.h"  // pi_offload compiles this file, too

#include <fstream>
#include <stdexcept>

namespace pi_detect
{
namespace
{

// Mean level per cell. Its first plane alone (grey pictures) gives the scores of "dark", which never comes, and zeros.
constexpr char TRUNK[] = R"(name: "tiny"
input: "data"
input_shape { dim: 1 dim: 3 dim: 32 dim: 32 }
layer { name: "mean" type: "Pooling" bottom: "data" top: "mean" pooling_param { pool: AVE kernel_size: 8 stride: 8 } }
layer { name: "planes" type: "Slice" bottom: "mean" top: "level" top: "rest" slice_param { axis: 1 slice_point: 1 } }
layer { name: "dark" type: "Power" bottom: "level" top: "dark" power_param { scale: 0 shift: -20 } }
layer { name: "zero" type: "Power" bottom: "level" top: "zero" power_param { scale: 0 } }
layer { name: "zero4" type: "Concat" bottom: "zero" bottom: "zero" bottom: "zero" bottom: "zero" top: "zero4" concat_param { axis: 1 } }
)";

// Confidences of background, bright and dark, and box codes of 0.
constexpr char DETECTIONS_HEAD[] = R"(
layer { name: "background" type: "Power" bottom: "level" top: "background" power_param { scale: -4 } }
layer { name: "bright" type: "Power" bottom: "level" top: "bright" power_param { scale: 4 } }
layer { name: "conf" type: "Concat" bottom: "background" bottom: "bright" bottom: "dark" top: "conf" concat_param { axis: 1 } }
layer { name: "conf_perm" type: "Permute" bottom: "conf" top: "conf_perm" permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "loc_perm" type: "Permute" bottom: "zero4" top: "loc_perm" permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "loc" type: "Flatten" bottom: "loc_perm" top: "loc" flatten_param { axis: 1 } }
layer { name: "conf_rows" type: "Reshape" bottom: "conf_perm" top: "conf_rows" reshape_param { shape { dim: 0 dim: -1 dim: 3 } } }
layer { name: "conf_soft" type: "Softmax" bottom: "conf_rows" top: "conf_soft" softmax_param { axis: 2 } }
layer { name: "conf_flat" type: "Flatten" bottom: "conf_soft" top: "conf_flat" flatten_param { axis: 1 } }
layer { name: "priors" type: "PriorBox" bottom: "level" bottom: "data" top: "priors"
  prior_box_param { min_size: 8 clip: false variance: 0.1 variance: 0.1 variance: 0.2 variance: 0.2 step: 8 offset: 0.5 } }
layer { name: "detections" type: "DetectionOutput" bottom: "loc" bottom: "conf_flat" bottom: "priors" top: "detections"
  detection_output_param { num_classes: 3 share_location: true background_label_id: 0 nms_param { nms_threshold: 0.45 top_k: 100 }
  code_type: CENTER_SIZE keep_top_k: 100 confidence_threshold: 0.01 } }
)";

// Per cell logits: of the objectness, which is always 1, and of the classes 0 (never), bright and dark. A size of one
// cell has the logarithm 0.
constexpr char GRID_HEAD[] = R"(
layer { name: "object" type: "Power" bottom: "level" top: "object" power_param { scale: 0 shift: 20 } }
layer { name: "bright" type: "Power" bottom: "level" top: "bright" power_param { scale: 8 } }
layer { name: "cells" type: "Concat" bottom: "zero4" bottom: "object" bottom: "dark" bottom: "bright" bottom: "dark" top: "cells" concat_param { axis: 1 } }
layer { name: "rows" type: "Permute" bottom: "cells" top: "rows" permute_param { order: 0 order: 2 order: 3 order: 1 } }
)";

// Two bins per side with the same weight: half a cell.
constexpr char DISTRIBUTION_HEAD[] = R"(
layer { name: "bright" type: "Power" bottom: "level" top: "bright" power_param { scale: 8 } }
layer { name: "cells" type: "Concat" bottom: "dark" bottom: "bright" bottom: "dark" bottom: "zero4" bottom: "zero4" top: "cells" concat_param { axis: 1 } }
layer { name: "rows" type: "Permute" bottom: "cells" top: "rows" permute_param { order: 0 order: 2 order: 3 order: 1 } }
)";

constexpr char DESCRIPTION[] = R"(name: tiny
weights: {file: tiny.prototxt}
input: {width: 32, height: 32, mean: [127.5, 127.5, 127.5], scale: 0.00784313725, channels: rgb, resize: stretch}
labels: {1: bright, 2: dark}
score_threshold: 0.5
)";

constexpr char DETECTIONS_OUTPUT[] = "output: {kind: detections}\n";
constexpr char GRID_OUTPUT[] = "output: {kind: grid, strides: [8], offset: 0.5, activation: sigmoid}\n";
constexpr char DISTRIBUTION_OUTPUT[] = "output: {kind: distribution, strides: [8], bins: 2, activation: sigmoid}\n";

void write(const std::string& path, const std::string& content)
{
  std::ofstream file(path);
  file << content;
  file.close();
  if (!file)
  {
    throw std::runtime_error("cannot write " + path);
  }
}

}  // namespace

std::string writeTinyNetwork(const std::string& folder, TinyOutput output)
{
  const char* head = DETECTIONS_HEAD;
  const char* description = DETECTIONS_OUTPUT;
  if (output == TinyOutput::GRID)
  {
    head = GRID_HEAD;
    description = GRID_OUTPUT;
  }
  else if (output == TinyOutput::DISTRIBUTION)
  {
    head = DISTRIBUTION_HEAD;
    description = DISTRIBUTION_OUTPUT;
  }
  write(folder + "/tiny.prototxt", std::string(TRUNK) + head);
  write(folder + "/tiny.yaml", std::string(DESCRIPTION) + description);
  return folder + "/tiny.yaml";
}

}  // namespace pi_detect
