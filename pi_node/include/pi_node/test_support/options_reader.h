#pragma once

#include <gtest/gtest.h>
#include <pi_node/test_support/yaml_parameters.h>

#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace pi_node::test_support
{

using Names = std::vector<std::string>;

/// Reads the options of a node from YAML, as a launch file would have them read. Options has fromParameters(),
/// toParameters() and toText().
template <typename Options>
class OptionsReader
{
public:
  /// @param path  of the node's parameters, as "/ssd/".
  explicit OptionsReader(std::string path) : path_(std::move(path)) {}

  Options load(const std::string& yaml, Names* unknown) const
  {
    return Options::fromParameters(fromYaml(YAML::Load(yaml)), path_, unknown);
  }

  Options load(const std::string& yaml) const
  {
    Names unknown;
    return load(yaml, &unknown);
  }

  /// What is said of wrong values; "" if nothing is.
  std::string refusal(const std::string& yaml) const
  {
    try
    {
      load(yaml);
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "";
  }

  /// The file holds every parameter with its default.
  static void expectDefaultsOf(const std::string& yaml_file)
  {
    const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(yaml_file));
    Names unknown;
    const Options options = Options::fromParameters(yaml, "", &unknown);
    EXPECT_EQ(Names(), unknown);
    EXPECT_EQ(Options().toText(), options.toText());
    std::set<std::string> in_file;
    std::set<std::string> in_code;
    collectNames(yaml, "", &in_file);
    collectNames(Options().toParameters(), "", &in_code);
    EXPECT_EQ(in_code, in_file);
  }

private:
  const std::string path_;
};

inline bool begins(const std::string& text, const std::string& beginning)
{
  return text.rfind(beginning, 0) == 0;
}

}  // namespace pi_node::test_support
