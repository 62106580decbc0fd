#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/dnn.hpp>
#include <string>
#include <vector>

#include <pi_detect/model_description.h>
#include <pi_detect/target.h>
#include "detector/output_shapes.h"

namespace pi_detect
{

/// A network that OpenCV has read. Not thread safe.
class Network
{
public:
  /// Reads the files and runs the network once on a blank input. May crash on a damaged file: see checkModel().
  /// @throws ModelError naming the file and what OpenCV says, or the output that is not as the description says.
  Network(const ModelDescription& model, const TargetInUse& target);

  /// @param blob  1 x 3 x height x width floats of the model's input.
  /// @return outputs: DETECTIONS: rows of 7; GRID: rows of cells; DISTRIBUTION: likewise, or scores and distances of
  /// each stride in turn. Valid until the next call.
  /// @throws std::runtime_error with OpenCV's words.
  const std::vector<cv::Mat>& forward(const float* blob);

private:
  void read();
  std::vector<OutputShape> shapes() const;
  void checkOutputs();
  [[noreturn]] void refuseOutputs(const std::string& needed) const;

  const ModelDescription model_;
  cv::dnn::Net net_;
  std::vector<std::string> output_names_;
  std::vector<cv::Mat> outputs_;
};

/// Files there, not empty, sums as described. @throws ModelError
void checkFiles(const ModelDescription& model);

}  // namespace pi_detect
