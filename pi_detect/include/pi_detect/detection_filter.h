#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/model_description.h>

#include <map>
#include <string>
#include <vector>

namespace pi_detect
{

/// Which of a network's detections are wanted.
struct DetectionFilter
{
  float score_threshold = 0.0F;                   ///< 0: the model's own
  std::map<std::string, float> class_thresholds;  ///< by label, in place of score_threshold
  std::vector<std::string> classes;               ///< labels; empty: all
  /// Above which boxes of different classes suppress each other; 0: never; -1: the model's own.
  float class_agnostic_overlap = -1.0F;
  int max_detections = 100;  ///< the best

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;

  /// The score from which on a detection is wanted, by class id; the other classes are not.
  /// @throws std::invalid_argument naming a label that the model does not have.
  std::map<int, float> thresholds(const ModelDescription& model) const;
};

}  // namespace pi_detect
