#pragma once

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <limits>
#include <map>
#include <string>
#include <vector>

namespace pi_runtime
{

/// The paper's ETC table (π-Edge, section IV.A), learned from every run: expected execution times per codelet, size
/// bucket and column. A column is one executor of one unit ("cpu0/opencl"). Transfer times are not included: they
/// depend on where the data are, and the runtime adds them.
///
/// With few samples a mean is Welford's; later it is exponential, so that it follows a unit that slows down.
/// Not thread safe.
class EtcTable
{
public:
  using Column = size_t;
  static constexpr int NO_BUCKET = std::numeric_limits<int>::min();

  struct Cell
  {
    uint64_t count = 0;
    double mean_s = 0.0;
    double variance_s2 = 0.0;

    double deviation_s() const;
  };

  struct Estimate
  {
    double seconds = 0.0;      ///< expected, in [1e-9, 1e9]; 0 if nothing is known
    double deviation_s = 0.0;  ///< standard deviation
    bool known = false;        ///< false: the codelet never ran anywhere
    bool measured = false;     ///< true: from runs of this column; false: from runs on other units
  };

  /// All cells of one codelet.
  class Row
  {
  public:
    /// From the cell; without one from the nearest bucket of the column, scaled by the size; without that likewise from
    /// the mean of the other columns.
    Estimate predict(int bucket, Column column) const;
    /// Runs seen in this column, of any size.
    uint64_t samples(Column column) const;

  private:
    friend class EtcTable;
    bool fromColumn(int bucket, Column column, Estimate* estimate) const;
    std::vector<std::map<int, Cell>> columns_;
  };

  struct Entry
  {
    std::string codelet;
    int bucket;
    std::string column;
    Cell cell;
  };

  /// Accuracy of predictions that were made from measured cells.
  struct PredictionError
  {
    uint64_t count = 0;
    double p50 = 0.0;  ///< median of |predicted - real| / real, over the last 4096
    double p95 = 0.0;
  };

  /// Buckets are quarter octaves: sizes within about 9 % share one. Sizes <= 0 count as 1.
  static int sizeBucket(double size);

  /// The column of this name; adds it if it is new.
  Column column(const std::string& name);
  const std::vector<std::string>& columns() const { return columns_; }
  /// The row of a codelet; adds it if it is new. Valid as long as the table.
  Row& row(const std::string& codelet);
  /// Null if the codelet has no row.
  const Row* find(const std::string& codelet) const;

  void record(Row& row, int bucket, Column column, double seconds);
  /// Updates predictionError().
  void recordPrediction(double predicted_s, double real_s);
  PredictionError predictionError() const;

  /// Sets one cell. @throws std::invalid_argument naming the field that is out of bounds.
  void set(const Entry& entry);
  std::vector<Entry> entries() const;
  void clear();

  /// Reads what save() wrote, and replaces the cells that it names.
  /// @throws std::runtime_error naming the line that is wrong; the table is then unchanged.
  void load(std::istream& input);
  /// Comma-separated text: codelet, bucket, column, count, mean [s], deviation [s].
  void save(std::ostream& output) const;
  /// As above with a file. load() fails if the file is missing; save() replaces the whole file.
  /// @throws std::runtime_error naming the file.
  void load(const std::string& path);
  void save(const std::string& path) const;

private:
  std::vector<std::string> columns_;
  std::map<std::string, Row> rows_;
  std::vector<float> errors_;  ///< ring of the last relative errors
  uint64_t error_count_ = 0;
};

}  // namespace pi_runtime
