#pragma once

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <yaml-cpp/yaml.h>

#include "bridge/config/setting.h"

namespace pi_os_transport
{

/// Reads one YAML file. Refuses unknown keys, repeated keys and values of the wrong kind.
class ConfigFile
{
public:
  using Reader = std::function<void(const YAML::Node& value, const std::string& key)>;

  explicit ConfigFile(std::string path) : path_(std::move(path)) {}

  // All throw std::runtime_error with a line that names the place, the key and what is expected.

  /// The document; null if the file is empty.
  YAML::Node load() const;
  Setting scalar(const YAML::Node& node, const std::string& key) const;
  /// A list of scalars.
  std::vector<Setting> list(const YAML::Node& node, const std::string& key) const;
  std::vector<YAML::Node> items(const YAML::Node& node, const std::string& key) const;
  /// Calls the reader of each key of a map. `prefix` precedes the keys in messages.
  void readMap(const YAML::Node& map, const std::string& prefix, const std::map<std::string, Reader>& readers) const;

  /// "path:line: key", for messages.
  std::string place(const YAML::Node& node, const std::string& key) const;

private:
  const std::string path_;
};

}  // namespace pi_os_transport
