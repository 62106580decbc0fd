#pragma once

#include <pi_runtime/trace.h>

#include <algorithm>
#define BOOST_BIND_GLOBAL_PLACEHOLDERS  // silences a note of Boost 1.74 about its own use of them
#include <boost/property_tree/json_parser.hpp>
#include <boost/property_tree/ptree.hpp>
#include <istream>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_runtime
{

constexpr const char* OUTCOMES[] = {"ok", "failed", "cancelled"};

/// A trace that was read back.
struct ChromeTrace
{
  std::vector<TaskTrace> records;  ///< in the order of the file; their names live in `names`
  std::vector<std::string> units;
  std::set<std::string, std::less<>> names;

  ChromeTrace() = default;
  ChromeTrace(ChromeTrace&&) = default;
  ChromeTrace& operator=(ChromeTrace&&) = default;
  ChromeTrace(const ChromeTrace&) = delete;  // the names of the copy would be those of the original
  ChromeTrace& operator=(const ChromeTrace&) = delete;
};

using Tree = boost::property_tree::ptree;

inline TaskOutcome outcomeOf(const std::string& text)
{
  const auto* const found = std::find(std::begin(OUTCOMES), std::end(OUTCOMES), text);
  if (found == std::end(OUTCOMES))
  {
    throw std::runtime_error("a record has the outcome \"" + text + "\", known are ok, failed and cancelled");
  }
  return static_cast<TaskOutcome>(found - std::begin(OUTCOMES));
}

inline TaskTrace readRecord(const Tree& arguments, std::set<std::string, std::less<>>* names)
{
  TaskTrace record;
  record.task = arguments.get<uint64_t>("task");
  record.codelet = *names->insert(arguments.get<std::string>("codelet")).first;
  record.implementation = *names->insert(arguments.get<std::string>("implementation")).first;
  record.unit = arguments.get<uint32_t>("unit");
  record.slice = arguments.get<uint32_t>("slice");
  record.slices = arguments.get<uint32_t>("slices");
  record.submitted_ns = arguments.get<int64_t>("submitted_ns");
  record.queued_ns = arguments.get<int64_t>("queued_ns");
  record.started_ns = arguments.get<int64_t>("started_ns");
  record.transfer_ns = arguments.get<int64_t>("transfer_ns");
  record.finished_ns = arguments.get<int64_t>("finished_ns");
  record.deadline_ns = arguments.get<int64_t>("deadline_ns");
  record.outcome = outcomeOf(arguments.get<std::string>("outcome"));
  record.stolen = arguments.get<bool>("stolen");
  record.predicted_s = arguments.get<double>("predicted_s");
  return record;
}

inline void readUnitName(const Tree& event, std::vector<std::string>* units)
{
  constexpr uint64_t MOST_UNITS = 4096;
  const auto thread = event.get<uint64_t>("tid");
  if (thread < 1 || thread > MOST_UNITS)
  {
    throw std::runtime_error("a thread_name has the tid " + std::to_string(thread) + ", must be in [1, 4096]");
  }
  units->resize(std::max<size_t>(units->size(), thread));
  (*units)[thread - 1] = event.get<std::string>("args.name");
}

/// Reads what writeChromeTrace() has written; events of others are skipped.
/// @throws std::runtime_error, naming the place, if it is no JSON or a record lacks a field.
inline ChromeTrace readChromeTrace(std::istream& stream)
{
  try
  {
    Tree tree;
    boost::property_tree::read_json(stream, tree);
    ChromeTrace trace;
    for (const auto& [key, event] : tree.get_child("traceEvents"))
    {
      const auto arguments = event.get_child_optional("args");
      if (event.get<std::string>("cat", "") == "run" && arguments)
      {
        trace.records.push_back(readRecord(*arguments, &trace.names));
      }
      else if (event.get<std::string>("ph", "") == "M" && event.get<std::string>("name", "") == "thread_name")
      {
        readUnitName(event, &trace.units);
      }
    }
    return trace;
  }
  catch (const boost::property_tree::ptree_error& error)
  {
    throw std::runtime_error(std::string("not a trace of pi_runtime: ") + error.what());
  }
}

}  // namespace pi_runtime
