#pragma once

#include <cstddef>
#include <istream>
#include <string>
#include <vector>

namespace pi_runtime
{

/// The paper's ETC table (π-Edge, section IV.A): expected execution times ETC(t_i, c_j) of tasks (rows) on computing
/// units (columns), data movement included. The caller chooses the unit of time. +infinity: the unit cannot run the
/// task.
class EtcMatrix
{
public:
  EtcMatrix() = default;
  /// All entries are +infinity.
  EtcMatrix(size_t tasks, size_t units);
  /// @param values row-major, tasks * units entries.
  /// @throws std::invalid_argument if the number of values differs.
  EtcMatrix(size_t tasks, size_t units, std::vector<double> values);

  size_t tasks() const { return tasks_; }
  size_t units() const { return units_; }

  /// No range check.
  double& at(size_t task, size_t unit) { return values_[task * units_ + unit]; }
  double at(size_t task, size_t unit) const { return values_[task * units_ + unit]; }
  /// units() entries.
  const double* row(size_t task) const { return values_.data() + task * units_; }

  /// Changes the size and keeps the memory; the entries are unspecified afterwards.
  void resize(size_t tasks, size_t units);

  /// @throws std::invalid_argument naming task, unit and value if an entry is NaN, zero or negative.
  void validate() const;

private:
  size_t tasks_ = 0;
  size_t units_ = 0;
  std::vector<double> values_;
};

/// Reads a matrix from comma-separated text, one line per task and one field per unit. `inf` is infinity. Blank lines
/// and lines that begin with # are skipped; a first line none of whose fields is a number is a header and skipped too.
/// The values are not range-checked, see EtcMatrix::validate().
/// @throws std::runtime_error naming line number, text and what is expected.
EtcMatrix readEtcCsv(std::istream& input);
/// As above; the error names the file too, also if it cannot be opened.
EtcMatrix readEtcCsv(const std::string& path);

}  // namespace pi_runtime
