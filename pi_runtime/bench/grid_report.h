#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace pi_runtime_bench
{

/// Figures of one contender on the sets of one cell.
struct Series
{
  std::vector<double> ratio;      ///< makespan / Min-Min's
  std::vector<double> met_ratio;  ///< makespan / MET's
  std::vector<double> gap;        ///< makespan / optimum - 1
  std::vector<double> time_us;
};

/// The sets of one number of tasks and units.
struct Cell
{
  size_t tasks = 0;
  size_t units = 0;
  std::vector<std::string> names;        ///< of the contenders, as columns; the baseline first
  std::map<std::string, Series> series;  ///< by contender; "optimum" too
  size_t proven = 0;                     ///< sets whose optimum is proven
};

/// A line of column titles for figures printed with " %11".
void printHeader(const std::string& first, const std::vector<std::string>& columns);

/// The tables of the grid, how close the search comes, and which of the paper's claims the figures support.
void printReport(const std::vector<Cell>& cells);

/// @throws std::runtime_error if the file cannot be written.
void writeCsv(const std::string& path, const std::vector<Cell>& cells);

}  // namespace pi_runtime_bench
