#include "grid_report.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <fstream>
#include <stdexcept>

namespace pi_runtime_bench
{
namespace
{

double mean(const std::vector<double>& values)
{
  double sum = 0.0;
  for (double value : values)
  {
    sum += value;
  }
  return sum / static_cast<double>(values.size());
}

double standardError(const std::vector<double>& values)
{
  const double centre = mean(values);
  double squares = 0.0;
  for (double value : values)
  {
    squares += (value - centre) * (value - centre);
  }
  const auto count = static_cast<double>(values.size());
  return std::sqrt(squares / std::max(count - 1.0, 1.0) / count);
}

double quantile(std::vector<double> values, double q)
{
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(q * static_cast<double>(values.size() - 1) + 0.5)];
}

/// One line per cell and one with the mean of the cells.
template <typename Figure>
void printTable(const std::string& title, const std::vector<Cell>& cells, bool with_optimum, int digits, Figure figure)
{
  std::vector<std::string> names = cells.front().names;
  if (with_optimum)
  {
    names.emplace_back("optimum");
  }
  std::printf("\n%s\n", title.c_str());
  printHeader("units x tasks", names);
  std::map<std::string, double> sums;
  for (const Cell& cell : cells)
  {
    std::printf("%zu x %-14zu", cell.units, cell.tasks);
    for (const std::string& name : names)
    {
      const double value = figure(cell.series.at(name));
      sums[name] += value;
      std::printf(" %11.*f", digits, value);
    }
    std::printf("\n");
  }
  std::printf("%-18s", "mean of the cells");
  for (const std::string& name : names)
  {
    std::printf(" %11.*f", digits, sums[name] / static_cast<double>(cells.size()));
  }
  std::printf("\n");
}

/// By how much Diff-Min is shorter than a baseline, over all cells [%].
struct Reduction
{
  double mean = 0.0;
  double best = -100.0;
  size_t best_units = 0;
  size_t best_tasks = 0;
  size_t cells_longer = 0;  ///< by more than two standard errors
  size_t cells_shorter = 0;
};

Reduction reductionOf(const std::vector<Cell>& cells, const std::string& name, std::vector<double> Series::*ratio)
{
  Reduction result;
  for (const Cell& cell : cells)
  {
    const std::vector<double>& ratios = cell.series.at(name).*ratio;
    const double reduction = 1.0 - pi_runtime_bench::mean(ratios);
    const double noise = 2.0 * standardError(ratios);
    result.mean += 100.0 * reduction / static_cast<double>(cells.size());
    result.cells_longer += reduction < -noise ? 1 : 0;
    result.cells_shorter += reduction > noise ? 1 : 0;
    if (100.0 * reduction > result.best)
    {
      result.best = 100.0 * reduction;
      result.best_units = cell.units;
      result.best_tasks = cell.tasks;
    }
  }
  return result;
}

void printVerdict(const char* claim, bool holds)
{
  std::printf("  => %s: %s\n", claim, holds ? "REPLICATES" : "DOES NOT REPLICATE");
}

void printClaims(const std::vector<Cell>& cells)
{
  constexpr double CLAIMED_BEST = 27.5;
  constexpr double CLAIMED_MEAN = 10.0;
  const auto cellOf = [&cells](size_t units, size_t tasks) -> const Cell&
  {
    return *std::find_if(cells.begin(), cells.end(),
                         [&](const Cell& cell) { return cell.units == units && cell.tasks == tasks; });
  };
  const auto reduction = [](const Cell& cell, const char* name)
  { return 100.0 * (1.0 - pi_runtime_bench::mean(cell.series.at(name).ratio)); };

  std::printf("\nWhat of the paper's figure 9 replicates (reduction of the makespan, + is shorter)\n");
  const Reduction max_div = reductionOf(cells, "diff_min", &Series::ratio);
  const Reduction min_div = reductionOf(cells, "dm_min_div", &Series::ratio);
  std::printf(
      "Mean of the cells, Diff-Min against Min-Min: max Div (formal steps) %+.1f %%, min Div (prose) %+.1f %%;\n"
      "  the optimum itself %+.1f %%.\n",
      max_div.mean, min_div.mean, reductionOf(cells, "optimum", &Series::ratio).mean);
  printVerdict("\"the makespan can averagely be reduced by 10 %\"",
               std::max(max_div.mean, min_div.mean) >= CLAIMED_MEAN);

  const Cell& best = cellOf(4, 20);
  const double optimum = reduction(best, "optimum");
  std::printf("20 tasks on 4 units: max Div %+.1f %%, min Div %+.1f %%, optimum %+.1f %%%s.\n",
              reduction(best, "diff_min"), reduction(best, "dm_min_div"), optimum,
              optimum < CLAIMED_BEST ? ": no scheduler at all reaches 27.5 % there" : "");
  printVerdict("\"best case of 20 tasks on 4 processors, up to 27.5 %\"",
               std::max(reduction(best, "diff_min"), reduction(best, "dm_min_div")) >= CLAIMED_BEST);

  const Cell& downgrade = cellOf(5, 40);
  std::printf(
      "40 tasks on 5 units: max Div %+.1f %%, min Div %+.1f %%. Cells in which Diff-Min is longer / shorter than\n"
      "  Min-Min beyond two standard errors: max Div %zu / %zu, min Div %zu / %zu of %zu.\n",
      reduction(downgrade, "diff_min"), reduction(downgrade, "dm_min_div"), max_div.cells_longer, max_div.cells_shorter,
      min_div.cells_longer, min_div.cells_shorter, cells.size());
  printVerdict("\"a downgrade in the case of processor 5 and task 40\"", reduction(downgrade, "diff_min") < 0.0);
  printVerdict("\"however, it happens in very low frequency\"", max_div.cells_longer <= 2);

  const Reduction met = reductionOf(cells, "diff_min", &Series::met_ratio);
  std::printf(
      "Against MET, which is Min-Min as printed (\"M = [min ETC]\", no load): mean %+.1f %%, best cell %zu x %zu\n"
      "  %+.1f %%. With this baseline the mean of 10 %% %s; that the authors used it is a guess.\n",
      met.mean, met.best_units, met.best_tasks, met.best,
      std::abs(met.mean - CLAIMED_MEAN) <= 2.5 ? "comes out" : "does not come out either");
}

void printSearchSummary(const std::vector<Cell>& cells)
{
  std::vector<double> gaps;
  std::vector<double> means;
  size_t proven = 0;
  for (const Cell& cell : cells)
  {
    const Series& series = cell.series.at("search");
    gaps.insert(gaps.end(), series.gap.begin(), series.gap.end());
    means.push_back(mean(series.gap));
    proven += cell.proven;
  }
  const auto optimal = std::count_if(gaps.begin(), gaps.end(), [](double gap) { return gap < 1e-9; });
  const Cell& largest = cells.back();
  const std::vector<double>& times = largest.series.at("search").time_us;
  std::printf(
      "\nSearch against the optimum (proven for %zu of %zu sets): mean gap %.3f %%, worst cell %.2f %%, worst set\n"
      "  %.1f %%, exactly optimal %.1f %%; %zu tasks on %zu units: p50 %.0f us, p99 %.0f us.\n",
      proven, gaps.size(), 100.0 * mean(gaps), 100.0 * *std::max_element(means.begin(), means.end()),
      100.0 * *std::max_element(gaps.begin(), gaps.end()),
      100.0 * static_cast<double>(optimal) / static_cast<double>(gaps.size()), largest.tasks, largest.units,
      quantile(times, 0.5), quantile(times, 0.99));
}

}  // namespace

void printHeader(const std::string& first, const std::vector<std::string>& columns)
{
  std::printf("%-18s", first.c_str());
  for (const std::string& column : columns)
  {
    std::printf(" %11s", column.c_str());
  }
  std::printf("\n");
}

void writeCsv(const std::string& path, const std::vector<Cell>& cells)
{
  std::ofstream file(path);
  file << "units,tasks,policy,normalised_makespan,standard_error,gap_to_optimum,time_p50_us,time_p99_us\n";
  for (const Cell& cell : cells)
  {
    for (const auto& [name, series] : cell.series)
    {
      file << cell.units << ',' << cell.tasks << ',' << name << ',' << mean(series.ratio) << ','
           << standardError(series.ratio) << ',' << mean(series.gap) << ',';
      if (!series.time_us.empty())
      {
        file << quantile(series.time_us, 0.5) << ',' << quantile(series.time_us, 0.99);
      }
      else
      {
        file << ',';
      }
      file << '\n';
    }
  }
  file.flush();
  if (!file)
  {
    throw std::runtime_error("output-csv = \"" + path + "\" cannot be written, expected a writable file");
  }
}

void printReport(const std::vector<Cell>& cells)
{
  printTable("Makespan normalised to Min-Min, mean of the sets", cells, true, 3,
             [](const Series& series) { return mean(series.ratio); });
  printTable("Gap to the optimum, mean of the sets [%]", cells, false, 2,
             [](const Series& series) { return 100.0 * mean(series.gap); });
  printTable("Time per call, median [us]", cells, false, 1,
             [](const Series& series) { return quantile(series.time_us, 0.5); });
  printTable("Time per call, 99th percentile [us]", cells, false, 1,
             [](const Series& series) { return quantile(series.time_us, 0.99); });
  printSearchSummary(cells);
  printClaims(cells);
}

}  // namespace pi_runtime_bench
