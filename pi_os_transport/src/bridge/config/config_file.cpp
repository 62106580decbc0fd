#include "bridge/config/config_file.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <set>
#include <sstream>
#include <stdexcept>

namespace pi_os_transport
{
namespace
{

std::string describe(const YAML::Node& node)
{
  switch (node.Type())
  {
    case YAML::NodeType::Scalar:
      return "\"" + node.Scalar() + "\"";
    case YAML::NodeType::Sequence:
      return "a list";
    case YAML::NodeType::Map:
      return "a map";
    default:
      return "nothing";
  }
}

}  // namespace

YAML::Node ConfigFile::load() const
{
  errno = 0;
  std::ifstream stream(path_);
  std::ostringstream text;
  if (stream.is_open() && stream.peek() != std::ifstream::traits_type::eof())
  {
    text << stream.rdbuf();
  }
  if (!stream.is_open() || stream.bad())
  {
    throw std::runtime_error("--config = \"" + path_ +
                             "\", must be a file that can be read: " + std::strerror(errno != 0 ? errno : EIO));
  }
  try
  {
    const std::vector<YAML::Node> documents = YAML::LoadAll(text.str());
    if (documents.size() > 1)
    {
      throw std::runtime_error(path_ + ": must hold one YAML document, holds " + std::to_string(documents.size()));
    }
    return documents.empty() ? YAML::Node() : documents.front();
  }
  catch (const YAML::ParserException& exception)
  {
    throw std::runtime_error(path_ + ":" + std::to_string(exception.mark.line + 1) + ": is no YAML: " + exception.msg);
  }
}

std::string ConfigFile::place(const YAML::Node& node, const std::string& key) const
{
  return path_ + ":" + std::to_string(node.Mark().line + 1) + ": " + key;
}

Setting ConfigFile::scalar(const YAML::Node& node, const std::string& key) const
{
  if (!node.IsScalar())
  {
    throw std::runtime_error(place(node, key) + " = " + describe(node) + ", must be a single value");
  }
  return {place(node, key), node.Scalar()};
}

std::vector<Setting> ConfigFile::list(const YAML::Node& node, const std::string& key) const
{
  std::vector<Setting> settings;
  for (const YAML::Node& item : items(node, key))
  {
    settings.push_back(scalar(item, key + "[" + std::to_string(settings.size()) + "]"));
  }
  return settings;
}

std::vector<YAML::Node> ConfigFile::items(const YAML::Node& node, const std::string& key) const
{
  if (!node.IsSequence())
  {
    throw std::runtime_error(place(node, key) + " = " + describe(node) + ", must be a list like [a, b]");
  }
  return std::vector<YAML::Node>(node.begin(), node.end());
}

void ConfigFile::readMap(const YAML::Node& map, const std::string& prefix,
                         const std::map<std::string, Reader>& readers) const
{
  if (!map.IsMap())
  {
    throw std::runtime_error(place(map, prefix) + (prefix.empty() ? "the file" : "") + " = " + describe(map) +
                             ", must be a map of keys and values");
  }
  std::set<std::string> seen;
  for (const auto& entry : map)
  {
    const std::string name = entry.first.IsScalar() ? entry.first.Scalar() : describe(entry.first);
    const std::string key = prefix.empty() ? name : prefix + "." + name;
    const auto reader = readers.find(name);
    if (reader == readers.end())
    {
      std::string known;
      for (const auto& [candidate, unused] : readers)
      {
        known += (known.empty() ? "" : ", ") + candidate;
      }
      throw std::runtime_error(place(entry.first, key) + " is no option, must be one of " + known);
    }
    if (!seen.insert(name).second)
    {
      throw std::runtime_error(place(entry.first, key) + " is given twice, must be given once");
    }
    reader->second(entry.second, key);
  }
}

}  // namespace pi_os_transport
