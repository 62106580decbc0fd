#pragma once

#include <yaml-cpp/yaml.h>

#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_node
{

/// A YAML map whose fields are asked for one by one; at the end, what nobody asked for is refused.
/// All errors are std::invalid_argument: "<path> = <value>, must be <bound>". Not thread safe.
class YamlSection
{
public:
  /// @param path  in front of field names in messages, such as "reaction.yaml: rules/2".
  YamlSection(YAML::Node node, std::string path) : node_(std::move(node)), path_(std::move(path))
  {
    if (!node_.IsMap())
    {
      throw std::invalid_argument(path_ + " must be a map of fields");
    }
  }

  /// A text as the top section. @param name  of the source, in messages.
  static YamlSection parse(const std::string& text, const std::string& name)
  {
    try
    {
      return YamlSection(YAML::Load(text), name + ":");
    }
    catch (const YAML::Exception& error)
    {
      throw std::invalid_argument(name + ": no YAML: " + error.what());
    }
  }

  /// A file as the top section.
  static YamlSection load(const std::string& path)
  {
    try
    {
      return YamlSection(YAML::LoadFile(path), path + ":");
    }
    catch (const YAML::BadFile&)
    {
      throw std::invalid_argument(path + ": cannot be read: check the path");
    }
    catch (const YAML::Exception& error)
    {
      throw std::invalid_argument(path + ": no YAML: " + error.what());
    }
  }

  std::string name(const std::string& field) const { return path_ + (path_.back() == ':' ? " " : "/") + field; }

  bool has(const std::string& field)
  {
    known_.insert(field);
    return node_[field].IsDefined() && !node_[field].IsNull();
  }

  YAML::Node node(const std::string& field)
  {
    if (!has(field))
    {
      throw std::invalid_argument(name(field) + " is missing");
    }
    return node_[field];
  }

  YamlSection section(const std::string& field) { return YamlSection(node(field), name(field)); }

  /// The entries of a list of maps.
  std::vector<YamlSection> list(const std::string& field)
  {
    const YAML::Node entries = node(field);
    if (!entries.IsSequence())
    {
      throw std::invalid_argument(name(field) + " must be a list");
    }
    std::vector<YamlSection> sections;
    for (size_t i = 0; i < entries.size(); ++i)
    {
      sections.emplace_back(entries[i], name(field) + "/" + std::to_string(i));
    }
    return sections;
  }

  [[noreturn]] void refuse(const std::string& field, const std::string& value, const std::string& bound) const
  {
    throw std::invalid_argument(name(field) + " = " + value + ", must be " + bound);
  }

  /// @param kind  what it must be, as "a number".
  template <typename Value>
  Value get(const std::string& field, const char* kind)
  {
    const YAML::Node value = node(field);
    try
    {
      return value.as<Value>();
    }
    catch (const YAML::Exception&)
    {
      refuse(field, value.IsScalar() ? "\"" + value.Scalar() + "\"" : "(not a single value)", kind);
    }
  }

  /// Leaves `value` as it is where the field is missing.
  template <typename Value>
  void read(const std::string& field, const char* kind, Value* value)
  {
    if (has(field))
    {
      *value = get<Value>(field, kind);
    }
  }

  /// A number in [least, most]; missing: `value` stays.
  void readNumber(const std::string& field, double least, double most, double* value)
  {
    read(field, "a number", value);
    if (!(*value >= least && *value <= most))
    {
      std::ostringstream number;
      std::ostringstream bound;
      number << *value;
      bound << "in [" << least << ", " << most << "]";
      refuse(field, number.str(), bound.str());
    }
  }

  /// Options with a function visitFields(options, visit).
  template <typename Options>
  void readFields(Options* options)
  {
    visitFields(*options, [this](const char* field, auto& value) { read(field, "of the right kind", &value); });
    finish();
  }

  /// @throws for a field that nobody asked for: likely a slip.
  void finish() const
  {
    for (const auto& entry : node_)
    {
      const auto field = entry.first.as<std::string>();
      if (known_.count(field) == 0)
      {
        std::string known;
        for (const std::string& one : known_)
        {
          known += (known.empty() ? "" : ", ") + one;
        }
        throw std::invalid_argument(name(field) + " means nothing here; known are " + known);
      }
    }
  }

private:
  YAML::Node node_;
  std::string path_;
  std::set<std::string> known_;
};

}  // namespace pi_node
