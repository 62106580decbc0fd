#include <pi_detect/detection_filter.h>

#include <pi_node/option_check.h>

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace pi_detect
{
namespace
{

/// Of a class: with 0 it would find everything.
constexpr float LEAST_THRESHOLD = 1e-6F;

void requireLabel(const ModelDescription& model, const std::string& label, const char* field)
{
  if (model.idOf(label) < 0)
  {
    throw std::invalid_argument(std::string(field) + ": model " + model.name + " has no class \"" + label +
                                "\"; its labels are in " + model.path);
  }
}

}  // namespace

void DetectionFilter::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("score_threshold", score_threshold, 0.0F, 1.0F);
  for (const auto& [label, threshold] : class_thresholds)
  {
    check.range(("class_thresholds/" + label).c_str(), threshold, LEAST_THRESHOLD, 1.0F);
  }
  if (class_agnostic_overlap != -1.0F && !(class_agnostic_overlap >= 0.0F && class_agnostic_overlap < 1.0F))
  {
    throw std::invalid_argument("class_agnostic_overlap = " + std::to_string(class_agnostic_overlap) +
                                ", must be in [0, 1), or -1 for the model's own");
  }
  check.range("max_detections", max_detections, 1, std::numeric_limits<int>::max());
}

std::map<int, float> DetectionFilter::thresholds(const ModelDescription& model) const
{
  for (const std::string& label : classes)
  {
    requireLabel(model, label, "classes");
  }
  for (const auto& [label, threshold] : class_thresholds)
  {
    requireLabel(model, label, "class_thresholds");
  }
  const float usual = score_threshold > 0.0F ? score_threshold : model.score_threshold;
  std::map<int, float> thresholds;
  for (const auto& [id, label] : model.labels)
  {
    if (classes.empty() || std::find(classes.begin(), classes.end(), label) != classes.end())
    {
      const auto own = class_thresholds.find(label);
      thresholds[id] = own == class_thresholds.end() ? usual : own->second;
    }
  }
  return thresholds;
}

}  // namespace pi_detect
