#pragma once

#include <pi_node/stop_signal.h>

#include <boost/program_options.hpp>

#include <cstdlib>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace pi_node
{

/// The command line of a tool: options, positional arguments, --help. Link Boost::program_options.
/// Not thread safe.
class CommandLine
{
public:
  static constexpr int BAD_USAGE = 2;  ///< exit status after an error in the command line

  /// @param usage  head of the help text, for example "simulate --scenario S.yaml [options]".
  explicit CommandLine(const std::string& usage) : visible_(usage)
  {
    visible_.add_options()("help,h", "show this text");
  }

  /// An option with a value. @param names  "seed" or "seed,s". @param value  as boost::program_options::value(&field).
  void add(const char* names, const boost::program_options::value_semantic* value, const char* description)
  {
    visible_.add_options()(names, value, description);
  }
  /// The same; the help text shows what `field` holds as the default.
  template <typename Field>
  void addValue(const char* names, Field* field, const char* description)
  {
    add(names, boost::program_options::value(field)->default_value(*field), description);
  }
  /// An option without a value.
  void addFlag(const char* names, bool* flag, const char* description)
  {
    add(names, boost::program_options::bool_switch(flag), description);
  }
  /// Options under a heading of their own in the help text.
  void addGroup(const boost::program_options::options_description& group) { visible_.add(group); }

  /// The next positional argument. @param missing  the error if it is not given; empty: it may be left out.
  void addPositional(const char* name, std::string* field, const std::string& missing)
  {
    addPositional(name, boost::program_options::value(field), 1, missing);
  }
  /// All further positional arguments.
  void addPositional(const char* name, std::vector<std::string>* fields, const std::string& missing)
  {
    addPositional(name, boost::program_options::value(fields), -1, missing);
  }

  /// Sets the fields. @return false if --help was given: the help text is then on standard output.
  /// @throws boost::program_options::error, or std::invalid_argument with the text of a missing positional argument.
  bool parse(const std::vector<std::string>& words)
  {
    namespace po = boost::program_options;
    po::options_description all;
    all.add(visible_).add(hidden_);
    po::store(po::command_line_parser(words).options(all).positional(positions_).run(), values_);
    if (values_.count("help") != 0)
    {
      std::cout << visible_;
      return false;
    }
    for (const Positional& positional : required_)
    {
      if (values_.count(positional.name) == 0)
      {
        throw std::invalid_argument(positional.missing);
      }
    }
    po::notify(values_);
    return true;
  }
  bool parse(int argc, char** argv) { return parse(std::vector<std::string>(argv + 1, argv + argc)); }

  /// Whether the command line has this option. Call after parse().
  bool given(const char* name) const { return values_.count(name) != 0 && !values_[name].defaulted(); }

private:
  struct Positional
  {
    std::string name;
    std::string missing;
  };

  void addPositional(const char* name, const boost::program_options::value_semantic* value, int count,
                     const std::string& missing)
  {
    hidden_.add_options()(name, value);
    positions_.add(name, count);
    if (!missing.empty())
    {
      required_.push_back({name, missing});
    }
  }

  boost::program_options::options_description visible_;
  boost::program_options::options_description hidden_;
  boost::program_options::positional_options_description positions_;
  std::vector<Positional> required_;
  boost::program_options::variables_map values_;
};

/// The main() of a tool:
///
///   return pi_node::runTool("simulate", [&] { return parse(argc, argv, &line); }, [&] { return run(line); });
///
/// Exceptions become one line on standard error that begins with the tool's name.
/// @param parse  returns false if there is nothing to do (--help). After an exception the exit status is
///               CommandLine::BAD_USAGE.
/// @param run    returns the exit status. After an exception it is `failure`, or 128 + signal if a StopSignal came.
template <typename Parse, typename Run>
int runTool(const char* name, Parse parse, Run run, int failure = EXIT_FAILURE)
{
  try
  {
    if (!parse())
    {
      return EXIT_SUCCESS;
    }
  }
  catch (const boost::program_options::error& error)
  {
    std::cerr << name << ": " << error.what() << "; see --help\n";
    return CommandLine::BAD_USAGE;
  }
  catch (const std::exception& error)
  {
    std::cerr << name << ": " << error.what() << "\n";
    return CommandLine::BAD_USAGE;
  }
  try
  {
    return run();
  }
  catch (const std::exception& error)
  {
    std::cerr << name << ": " << error.what() << "\n";
    return StopSignal::came() ? StopSignal::exitStatus() : failure;
  }
}

}  // namespace pi_node
