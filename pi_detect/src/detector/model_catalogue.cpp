#include <pi_detect/model_catalogue.h>

#include <algorithm>
#include <boost/algorithm/string.hpp>
#include <cstdlib>
#include <filesystem>

namespace pi_detect
{
namespace
{

namespace fs = std::filesystem;

constexpr char ENDING[] = ".yaml";
constexpr char LIST_OF_DOWNLOADS[] = "catalogue";  ///< the one file of the folder that describes no network

std::string variable(const char* name)
{
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

std::string namesIn(const std::string& models)
{
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(models, error))
  {
    if (entry.path().extension() == ENDING && entry.path().stem() != LIST_OF_DOWNLOADS)
    {
      names.push_back(entry.path().stem().string());
    }
  }
  std::sort(names.begin(), names.end());
  return boost::join(names, ", ");
}

ModelDescription loadNamed(const std::string& name, const std::string& models)
{
  const fs::path path = fs::path(models) / (name + ENDING);
  std::error_code error;
  if (models.empty() || name == LIST_OF_DOWNLOADS || !fs::is_regular_file(path, error))
  {
    const std::string names = namesIn(models);
    throw ModelError("model \"" + name + "\" is no network of " + (models.empty() ? "pi_detect" : models) +
                     (names.empty() ? ": source the workspace's setup.sh" : ", which has " + names) +
                     ", or give the path of a description");
  }
  return ModelDescription::load(path.string());
}

}  // namespace

bool isModelPath(const std::string& model)
{
  return model.find('/') != std::string::npos || boost::ends_with(model, ENDING);
}

std::vector<std::string> weightsFolders()
{
  std::vector<std::string> folders;
  if (const std::string data = variable("PI_EDGE_DATA"); !data.empty())
  {
    folders.push_back(data + "/detect/models");
  }
  const std::string home = variable("HOME");
  const std::string share = variable("XDG_DATA_HOME");
  if (!share.empty() || !home.empty())
  {
    folders.push_back((share.empty() ? home + "/.local/share" : share) + "/pi_detect/models");
  }
  return folders;
}

ChosenModel chooseModel(const std::string& model, const std::string& models)
{
  const bool is_path = isModelPath(model);
  const ModelDescription asked_for = is_path ? ModelDescription::load(model) : loadNamed(model, models);
  std::error_code error;
  if (asked_for.fallback.empty() || fs::is_regular_file(asked_for.weights.path, error))
  {
    return {asked_for, ""};
  }
  const std::string folder = is_path ? fs::path(asked_for.path).parent_path().string() : models;
  const ModelDescription fallback = loadNamed(asked_for.fallback, folder);
  return {fallback, fallback.name + " stands in for " + asked_for.name +
                        ", whose weights are not on this computer, and " +
                        "sees much less: \"rosrun pi_detect fetch_models " + fs::path(asked_for.path).stem().string() +
                        "\" gets them"};
}

}  // namespace pi_detect
