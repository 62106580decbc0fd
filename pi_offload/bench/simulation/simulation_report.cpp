#include "simulation/simulation_report.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

namespace pi_offload
{
namespace
{

std::string number(double value, int digits)
{
  std::ostringstream text;
  text << std::fixed << std::setprecision(digits) << value;
  return text.str();
}

/// A figure of each seed's run.
struct Figure
{
  const char* name;
  double (*value)(const SimulationResult& result, double lambda);
};

constexpr size_t DETECTION = static_cast<size_t>(TaskKind::DETECTION);
constexpr size_t SPEECH = static_cast<size_t>(TaskKind::SPEECH);

/// Of all tasks.
double shareOf(const SimulationResult& result, uint64_t SimulationResult::OfKind::*part)
{
  uint64_t tasks = 0;
  uint64_t counted = 0;
  for (const auto& of : result.of_kind)
  {
    tasks += of.tasks;
    counted += of.*part;
  }
  return tasks > 0 ? static_cast<double>(counted) / static_cast<double>(tasks) : 0.0;
}

double leastServed(const SimulationResult& result)
{
  return result.tasks_of_vehicle.empty()
             ? 0.0
             : *std::min_element(result.tasks_of_vehicle.begin(), result.tasks_of_vehicle.end());
}

using R = const SimulationResult&;
const std::vector<Figure> FIGURES = {
    {"power_w", [](R r, double) { return r.power_w; }},
    {"local_w", [](R r, double) { return r.local_w; }},
    {"fallback_w", [](R r, double) { return r.fallback_w; }},
    {"radio_w", [](R r, double) { return r.radio_w; }},
    {"detection_tasks", [](R r, double) { return static_cast<double>(r.of_kind[DETECTION].tasks); }},
    {"detection_missed", [](R r, double) { return r.of_kind[DETECTION].miss_share(); }},
    {"detection_p50_s", [](R r, double) { return r.of_kind[DETECTION].p50_s; }},
    {"detection_p99_s", [](R r, double) { return r.of_kind[DETECTION].p99_s; }},
    {"detection_unanswered", [](R r, double) { return r.of_kind[DETECTION].unanswered_share(); }},
    {"speech_unanswered", [](R r, double) { return r.of_kind[SPEECH].unanswered_share(); }},
    {"speech_tasks", [](R r, double) { return static_cast<double>(r.of_kind[SPEECH].tasks); }},
    {"speech_missed", [](R r, double) { return r.of_kind[SPEECH].miss_share(); }},
    {"speech_p50_s", [](R r, double) { return r.of_kind[SPEECH].p50_s; }},
    {"speech_p99_s", [](R r, double) { return r.of_kind[SPEECH].p99_s; }},
    {"remote_share", [](R r, double) { return shareOf(r, &SimulationResult::OfKind::remote); }},
    {"fallback_share", [](R r, double) { return shareOf(r, &SimulationResult::OfKind::fallback); }},
    {"handovers", [](R r, double) { return static_cast<double>(r.handovers); }},
    {"regret", [](R r, double) { return r.regret(); }},
    {"cost_regret", [](R r, double lambda) { return r.regret(lambda); }},
    {"refused", [](R r, double) { return static_cast<double>(r.refused); }},
    {"expired", [](R r, double) { return static_cast<double>(r.expired); }},
    {"timeouts", [](R r, double) { return static_cast<double>(r.timeouts); }},
    {"served", [](R r, double) { return static_cast<double>(r.served); }},
    {"busy_share", [](R r, double) { return r.busy_share; }},
    {"fairness", [](R r, double) { return r.fairness(); }},
    {"least_served", [](R r, double) { return leastServed(r); }},
};

struct Spread
{
  double mean = 0.0;
  double deviation = 0.0;  ///< standard deviation over the seeds
};

Spread spreadOf(const Case& one, const std::string& name)
{
  const auto figure =
      std::find_if(FIGURES.begin(), FIGURES.end(), [&](const Figure& other) { return other.name == name; });
  Spread spread;
  const auto count = static_cast<double>(one.results.size());
  for (const SimulationResult& result : one.results)
  {
    spread.mean += figure->value(result, one.lambda) / count;
  }
  for (const SimulationResult& result : one.results)
  {
    const double off = figure->value(result, one.lambda) - spread.mean;
    spread.deviation += one.results.size() > 1 ? off * off / (count - 1.0) : 0.0;
  }
  spread.deviation = std::sqrt(spread.deviation);
  return spread;
}

/// A row of cells, each in its column's width.
void printRow(const std::vector<std::string>& cells, const std::vector<int>& widths)
{
  for (size_t i = 0; i < cells.size(); ++i)
  {
    std::cout << (i == 0 ? std::left : std::right) << (i == 0 ? "" : "  ") << std::setw(widths[i]) << cells[i];
  }
  std::cout << "\n";
}

}  // namespace

bool usesLambda(const std::string& policy)
{
  return policy == "expected_cost";
}

std::string plain(double value)
{
  std::ostringstream text;
  text << std::setprecision(9) << value;
  return text.str();
}

std::string csvText(const std::string& scenario, uint32_t first_seed, const std::vector<Case>& cases)
{
  std::ostringstream text;
  text << "scenario,policy,lambda,seed";
  for (const Figure& figure : FIGURES)
  {
    text << "," << figure.name;
  }
  text << "\n";
  for (const Case& one : cases)
  {
    for (size_t i = 0; i < one.results.size(); ++i)
    {
      text << scenario << "," << one.policy << "," << plain(one.lambda) << "," << first_seed + i;
      for (const Figure& figure : FIGURES)
      {
        text << "," << plain(figure.value(one.results[i], one.lambda));
      }
      text << "\n";
    }
  }
  return text.str();
}

std::string jsonText(const std::string& scenario, uint32_t first_seed, const std::vector<Case>& cases)
{
  nlohmann::ordered_json json;
  json["scenario"] = scenario;
  json["first_seed"] = first_seed;
  json["seeds"] = cases.empty() ? 0 : cases.front().results.size();
  json["cases"] = nlohmann::ordered_json::array();
  for (const Case& one : cases)
  {
    nlohmann::ordered_json of;
    of["policy"] = one.policy;
    of["lambda"] = one.lambda;
    for (const Figure& figure : FIGURES)
    {
      const Spread spread = spreadOf(one, figure.name);
      of[figure.name] = {{"mean", spread.mean}, {"deviation", spread.deviation}};
    }
    json["cases"].push_back(of);
  }
  return json.dump(2) + "\n";  // numbers that are not finite become null
}

void printTable(const std::vector<Case>& cases)
{
  const std::vector<std::string> names = {"policy",   "lambda",  "W",      "+-",   "det miss%",
                                          "sp miss%", "det p99", "sp p99", "hand", "fallback%",
                                          "regret%",  "+-",      "cost%"};
  const std::vector<int> widths = {16, 6, 6, 5, 9, 8, 7, 6, 6, 9, 8, 5, 8};
  printRow(names, widths);
  for (const Case& one : cases)
  {
    const auto percent = [&](const char* name, int digits) { return number(100.0 * spreadOf(one, name).mean, digits); };
    const auto ms = [&](const char* name) { return number(1e3 * spreadOf(one, name).mean, 0); };
    const bool oracle = one.policy == "oracle";
    printRow(
        {one.policy, usesLambda(one.policy) ? plain(one.lambda) : "-", number(spreadOf(one, "power_w").mean, 3),
         number(spreadOf(one, "power_w").deviation, 3), percent("detection_missed", 3), percent("speech_missed", 3),
         ms("detection_p99_s"), ms("speech_p99_s"), number(spreadOf(one, "handovers").mean, 0),
         percent("fallback_share", 2), oracle ? "-" : percent("regret", 1),
         oracle ? "-" : number(100.0 * spreadOf(one, "regret").deviation, 1), oracle ? "-" : percent("cost_regret", 1)},
        widths);
  }
  std::cout << "\n";
  printRow({"policy", "lambda", "local W", "fallb. W", "radio W", "remote%", "refused", "expired", "timeouts", "busy%",
            "fairness", "least"},
           {16, 6, 7, 8, 7, 7, 8, 8, 8, 6, 8, 8});
  for (const Case& one : cases)
  {
    const auto mean = [&](const char* name) { return spreadOf(one, name).mean; };
    printRow({one.policy, usesLambda(one.policy) ? plain(one.lambda) : "-", number(mean("local_w"), 3),
              number(mean("fallback_w"), 3), number(mean("radio_w"), 3), number(100.0 * mean("remote_share"), 1),
              number(mean("refused"), 0), number(mean("expired"), 0), number(mean("timeouts"), 0),
              number(100.0 * mean("busy_share"), 1), number(mean("fairness"), 3), number(mean("least_served"), 0)},
             {16, 6, 7, 8, 7, 7, 8, 8, 8, 6, 8, 8});
  }
}

void printCauses(const std::vector<Case>& cases)
{
  using Counts = std::map<std::string, uint64_t> SimulationResult::*;
  const auto print = [&](const char* title, Counts counts)
  {
    for (const Case& one : cases)
    {
      std::map<std::string, double> sums;
      for (const SimulationResult& result : one.results)
      {
        for (const auto& [cause, count] : result.*counts)
        {
          sums[cause] += static_cast<double>(count) / static_cast<double>(one.results.size());
        }
      }
      std::string text;
      for (const auto& [cause, mean] : sums)
      {
        text += (text.empty() ? "" : ", ") + cause + " " + number(mean, 1);
      }
      if (!text.empty())
      {
        const std::string price = usesLambda(one.policy) ? " " + plain(one.lambda) : "";
        std::cout << title << ", " << one.policy << price << ": " << text << "\n";
      }
    }
  };
  std::cout << "\n";
  print("fallbacks per run", &SimulationResult::fallback_reasons);
  print("misses per run", &SimulationResult::miss_reasons);
}

}  // namespace pi_offload
