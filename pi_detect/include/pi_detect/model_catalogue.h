#pragma once

#include <pi_detect/model_description.h>

#include <string>
#include <vector>

namespace pi_detect
{

/// Networks by name: NAME.yaml in config/models of this package, for example "fast", "accurate", "ssd_mobilenet" and
/// "street".
constexpr char DEFAULT_MODEL[] = "fast";  ///< on board

struct ChosenModel
{
  ModelDescription description;
  /// One line: why another network stands in for the one that was asked for, and how to get that; empty: it does not.
  std::string notice;
};

/// A network by its name, or by the path of its description (it has a slash or ends with .yaml). If its weights are not
/// on this computer, the network that its description names as `fallback`.
/// @param models  folder of the descriptions with names.
/// @throws ModelError for an unknown name, listing those that exist, and as ModelDescription::load().
ChosenModel chooseModel(const std::string& model, const std::string& models);

/// Whether chooseModel() takes it as a path.
bool isModelPath(const std::string& model);

/// Where weights are looked for besides the folder of their description: detect/models in PI_EDGE_DATA, where
/// fetch_models keeps its files (pi_detect/models in XDG_DATA_HOME, by default ~/.local/share).
std::vector<std::string> weightsFolders();

}  // namespace pi_detect
