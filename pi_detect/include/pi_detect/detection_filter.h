#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/model_description.h>

#include <map>
#include <string>
#include <vector>

namespace pi_detect
{

/// Selects detections of a network.
struct DetectionFilter
{
  float score_threshold = 0.0F;                   ///< 0: the model's own
  std::map<std::string, float> class_thresholds;  ///< by label, in place of score_threshold
  std::vector<std::string> classes;               ///< labels that are selected; empty: all
  /// Overlap above which boxes of different classes suppress each other; 0: never; -1: the model's own.
  float class_agnostic_overlap = -1.0F;
  int max_detections = 100;  ///< those with the best scores

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// The least score of each selected class, by class id.
  /// @throws std::invalid_argument naming a label that the model does not have.
  std::map<int, float> thresholds(const ModelDescription& model) const;
};

}  // namespace pi_detect
