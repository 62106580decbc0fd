#include "server/files.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>
#include <string_view>

namespace pi_web
{
namespace
{

namespace fs = std::filesystem;

constexpr uintmax_t MAX_ASSET_BYTES = 16000000;
constexpr size_t MAX_INCIDENTS = 100;
// incident_2026-11-29T16-40-00Z_cause.bag, by the recorder
constexpr std::string_view INCIDENT = "incident_";
constexpr size_t TIME_LENGTH = 20;
const std::map<std::string, std::string> TYPES = {{".html", "text/html; charset=utf-8"},
                                                  {".css", "text/css; charset=utf-8"},
                                                  {".js", "text/javascript; charset=utf-8"},
                                                  {".svg", "image/svg+xml"}};

std::string contentOf(const fs::path& path)
{
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

bool isIncident(const fs::path& name)
{
  const std::string text = name.string();
  return text.rfind(INCIDENT, 0) == 0 && name.extension() == ".bag" &&
         text.size() > INCIDENT.size() + TIME_LENGTH + 4 && text.find('/') == std::string::npos;
}

}  // namespace

std::string incidentFile(const std::string& folder, const std::string& name)
{
  return isIncident(name) ? (fs::path(folder) / name).string() : "";
}

std::string expanded(const std::string& path)
{
  const char* const home = std::getenv("HOME");
  return path.rfind("~/", 0) == 0 && home != nullptr ? home + path.substr(1) : path;
}

std::map<std::string, WebFile> pageFiles(const std::string& folder)
{
  std::map<std::string, WebFile> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
  {
    const auto type = TYPES.find(entry.path().extension().string());
    if (type != TYPES.end() && entry.is_regular_file())
    {
      const std::string name = entry.path().filename().string();
      files[name == "index.html" ? "/" : "/" + name] = {type->second, contentOf(entry.path()), nullptr, nullptr};
    }
  }
  if (files.count("/") == 0)
  {
    throw std::runtime_error("page_folder " + folder + " has no index.html" + (error ? ": " + error.message() : ""));
  }
  return files;
}

std::string packageFolder(const std::string& name)
{
  const char* const path = std::getenv("ROS_PACKAGE_PATH");
  std::stringstream entries((path == nullptr ? "" : path) + std::string(":/usr/share"));
  for (std::string entry; std::getline(entries, entry, ':');)
  {
    for (const fs::path& folder : {fs::path(entry) / name, fs::path(entry)})
    {
      std::error_code ignored;
      if (folder.filename() == name && fs::exists(folder / "package.xml", ignored))
      {
        return folder.string();
      }
    }
  }
  return "";
}

std::string assetOf(const std::string& uri)
{
  const std::string scheme = "package://";
  const size_t slash = uri.find('/', scheme.size());
  if (uri.rfind(scheme, 0) != 0 || slash == std::string::npos)
  {
    throw std::invalid_argument("only package://NAME/PATH is served");
  }
  const fs::path path = uri.substr(slash + 1);
  const std::string name = uri.substr(scheme.size(), slash - scheme.size());
  const std::vector<std::string> kinds = {".urdf", ".dae", ".stl", ".STL", ".obj"};
  if (std::find(kinds.begin(), kinds.end(), path.extension().string()) == kinds.end())
  {
    throw std::invalid_argument("only files .urdf, .dae, .stl and .obj are served");
  }
  const std::string folder = name.find("..") == std::string::npos ? packageFolder(name) : "";
  if (folder.empty())
  {
    throw std::invalid_argument("package " + name + " is not on ROS_PACKAGE_PATH");
  }
  std::error_code error;
  const fs::path root = fs::canonical(folder, error);
  const fs::path file = fs::canonical(root / path.relative_path(), error);
  const bool inside = !error && std::mismatch(root.begin(), root.end(), file.begin(), file.end()).first == root.end();
  if (!inside || !fs::is_regular_file(file, error) || fs::file_size(file, error) > MAX_ASSET_BYTES)
  {
    throw std::invalid_argument("package " + name + " has no such file of at most 16 MB");
  }
  return contentOf(file);
}

std::string incidentsJson(const std::string& folder)
{
  std::vector<fs::directory_entry> entries;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
  {
    if (isIncident(entry.path().filename()))
    {
      entries.push_back(entry);
    }
  }
  std::sort(entries.begin(), entries.end(),
            [](const auto& left, const auto& right) { return left.path().filename() > right.path().filename(); });
  nlohmann::json list = nlohmann::json::array();
  for (size_t i = 0; i < std::min(entries.size(), MAX_INCIDENTS); ++i)
  {
    const std::string name = entries[i].path().filename().string();
    const std::string cause = entries[i].path().stem().string().substr(INCIDENT.size() + TIME_LENGTH);
    const uintmax_t bytes = entries[i].file_size(error);
    list.push_back({{"file", name},
                    {"time", name.substr(INCIDENT.size(), TIME_LENGTH)},
                    {"cause", cause.substr(std::min<size_t>(cause.size(), 1))},
                    {"megabytes", error ? 0.0 : static_cast<double>(bytes) / 1e6}});
  }
  return list.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace pi_web
