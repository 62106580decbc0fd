#include <pi_runtime/etc_table.h>

#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iomanip>
#include <sstream>
#include <stdexcept>

namespace pi_runtime
{
namespace
{

const char* const FILE_HEADER = "codelet,bucket,column,count,mean_s,deviation_s";
constexpr double BUCKETS_PER_OCTAVE = 4.0;
/// A new sample weighs at least 1/64: a unit that changes its clock is followed within about as many runs.
constexpr uint64_t MEMORY_SAMPLES = 64;
constexpr size_t KEPT_ERRORS = 4096;
/// Buckets of the smallest and largest numbers that there are; predictions for the one from the other stay finite.
constexpr int LARGEST_BUCKET = 4400;
constexpr double SHORTEST_S = 1e-9;
constexpr double LONGEST_S = 1e9;
constexpr uint64_t LARGEST_COUNT = 1ull << 60;

double sizeRatio(int to, int from)
{
  return std::exp2(std::clamp((to - from) / BUCKETS_PER_OCTAVE, -1000.0, 1000.0));
}

EtcTable::Entry parseLine(const std::string& line, size_t number)
{
  std::vector<std::string> fields;
  std::istringstream stream(line);
  for (std::string field; std::getline(stream, field, ',');)
  {
    fields.push_back(field);
  }
  const std::string where = "line " + std::to_string(number) + " \"" + line + "\": ";
  if (fields.size() != 6)
  {
    throw std::runtime_error(where + "must be " + FILE_HEADER);
  }
  EtcTable::Entry entry;
  entry.codelet = fields[0];
  entry.column = fields[2];
  try
  {
    size_t used[4];
    entry.bucket = std::stoi(fields[1], &used[0]);
    entry.cell.count = std::stoull(fields[3], &used[1]);
    entry.cell.mean_s = std::stod(fields[4], &used[2]);
    const double deviation = std::stod(fields[5], &used[3]);
    entry.cell.variance_s2 = deviation * deviation;
    if (used[0] != fields[1].size() || used[1] != fields[3].size() || used[2] != fields[4].size() ||
        used[3] != fields[5].size())
    {
      throw std::invalid_argument("trailing text");
    }
  }
  catch (const std::exception&)
  {
    throw std::runtime_error(where + "bucket, count, mean_s and deviation_s must be numbers");
  }
  return entry;
}

/// As the file needs it, which is text with commas.
bool isWord(const std::string& text)
{
  return !text.empty() && std::all_of(text.begin(), text.end(),
                                      [](unsigned char letter) { return std::isgraph(letter) != 0 && letter != ','; });
}

void checkEntry(const EtcTable::Entry& entry)
{
  const std::string where = "ETC entry of " + entry.codelet + " on " + entry.column + ": ";
  if (!isWord(entry.codelet) || !isWord(entry.column))
  {
    throw std::invalid_argument(where + "codelet and column must be words without commas");
  }
  if (std::abs(static_cast<int64_t>(entry.bucket)) > LARGEST_BUCKET)
  {
    throw std::invalid_argument(where + "bucket = " + std::to_string(entry.bucket) + ", must be in [-" +
                                std::to_string(LARGEST_BUCKET) + ", " + std::to_string(LARGEST_BUCKET) + "]");
  }
  if (!(entry.cell.mean_s > 0.0 && entry.cell.mean_s <= LONGEST_S))
  {
    throw std::invalid_argument(where + "mean_s = " + std::to_string(entry.cell.mean_s) +
                                ", must be above 0 and at most 1e9");
  }
  if (!std::isfinite(entry.cell.variance_s2) || entry.cell.variance_s2 < 0.0)
  {
    throw std::invalid_argument(where + "deviation_s must be at least 0 and finite");
  }
  if (entry.cell.count == 0 || entry.cell.count > LARGEST_COUNT)
  {
    throw std::invalid_argument(where + "count = " + std::to_string(entry.cell.count) + ", must be in [1, 2^60]");
  }
}

}  // namespace

double EtcTable::Cell::deviation_s() const
{
  return std::sqrt(variance_s2);
}

int EtcTable::sizeBucket(double size)
{
  return size > 0.0 && std::isfinite(size) ? static_cast<int>(std::lround(std::log2(size) * BUCKETS_PER_OCTAVE)) : 0;
}

bool EtcTable::Row::fromColumn(int bucket, Column column, Estimate* estimate) const
{
  if (column >= columns_.size() || columns_[column].empty())
  {
    return false;
  }
  const std::map<int, Cell>& cells = columns_[column];
  auto nearest = cells.lower_bound(bucket);
  if (nearest == cells.end() || (nearest->first != bucket && nearest != cells.begin() &&
                                 bucket - std::prev(nearest)->first <= nearest->first - bucket))
  {
    --nearest;
  }
  const double scale = sizeRatio(bucket, nearest->first);
  estimate->seconds = std::clamp(nearest->second.mean_s * scale, SHORTEST_S, LONGEST_S);
  estimate->deviation_s = std::min(nearest->second.deviation_s() * scale, LONGEST_S);
  estimate->known = true;
  return true;
}

EtcTable::Estimate EtcTable::Row::predict(int bucket, Column column) const
{
  Estimate estimate;
  if (fromColumn(bucket, column, &estimate))
  {
    estimate.measured = true;
    return estimate;
  }
  double sum = 0.0;
  double deviations = 0.0;
  int known = 0;
  for (Column other = 0; other < columns_.size(); ++other)
  {
    if (fromColumn(bucket, other, &estimate))
    {
      sum += estimate.seconds;
      deviations += estimate.deviation_s;
      ++known;
    }
  }
  estimate.seconds = known == 0 ? 0.0 : sum / known;
  estimate.deviation_s = known == 0 ? 0.0 : deviations / known;
  return estimate;
}

uint64_t EtcTable::Row::samples(Column column) const
{
  uint64_t count = 0;
  if (column < columns_.size())
  {
    for (const auto& [bucket, cell] : columns_[column])
    {
      count += cell.count;
    }
  }
  return count;
}

EtcTable::Column EtcTable::column(const std::string& name)
{
  const auto found = std::find(columns_.begin(), columns_.end(), name);
  if (found != columns_.end())
  {
    return static_cast<Column>(found - columns_.begin());
  }
  columns_.push_back(name);
  return columns_.size() - 1;
}

EtcTable::Row& EtcTable::row(const std::string& codelet)
{
  return rows_[codelet];
}

const EtcTable::Row* EtcTable::find(const std::string& codelet) const
{
  const auto found = rows_.find(codelet);
  return found != rows_.end() ? &found->second : nullptr;
}

void EtcTable::record(Row& row, int bucket, Column column, double seconds)
{
  if (row.columns_.size() <= column)
  {
    row.columns_.resize(column + 1);
  }
  Cell& cell = row.columns_[column][bucket];
  ++cell.count;
  const double weight = 1.0 / static_cast<double>(std::min(cell.count, MEMORY_SAMPLES));
  const double difference = seconds - cell.mean_s;
  cell.mean_s += weight * difference;
  cell.variance_s2 = cell.count == 1 ? 0.0 : (1.0 - weight) * (cell.variance_s2 + weight * difference * difference);
}

void EtcTable::recordPrediction(double predicted_s, double real_s)
{
  if (!(predicted_s > 0.0) || !(real_s > 0.0))
  {
    return;
  }
  const auto error = static_cast<float>(std::abs(predicted_s - real_s) / real_s);
  if (errors_.size() < KEPT_ERRORS)
  {
    errors_.push_back(error);
  }
  else
  {
    errors_[error_count_ % KEPT_ERRORS] = error;
  }
  ++error_count_;
}

EtcTable::PredictionError EtcTable::predictionError() const
{
  PredictionError result;
  result.count = error_count_;
  if (!errors_.empty())
  {
    std::vector<float> sorted = errors_;
    std::sort(sorted.begin(), sorted.end());
    result.p50 = sorted[sorted.size() / 2];
    result.p95 = sorted[sorted.size() * 95 / 100];
  }
  return result;
}

void EtcTable::set(const Entry& entry)
{
  checkEntry(entry);
  const Column where = column(entry.column);
  Row& target = row(entry.codelet);
  if (target.columns_.size() <= where)
  {
    target.columns_.resize(where + 1);
  }
  target.columns_[where][entry.bucket] = entry.cell;
}

std::vector<EtcTable::Entry> EtcTable::entries() const
{
  std::vector<Entry> result;
  for (const auto& [codelet, row] : rows_)
  {
    for (Column column = 0; column < row.columns_.size(); ++column)
    {
      for (const auto& [bucket, cell] : row.columns_[column])
      {
        result.push_back(Entry{codelet, bucket, columns_[column], cell});
      }
    }
  }
  return result;
}

void EtcTable::clear()
{
  for (auto& [codelet, row] : rows_)
  {
    row.columns_.clear();
  }
}

void EtcTable::load(std::istream& input)
{
  std::vector<Entry> entries;
  std::string line;
  for (size_t number = 1; std::getline(input, line); ++number)
  {
    if (number == 1)
    {
      if (line != FILE_HEADER)
      {
        throw std::runtime_error("line 1 \"" + line.substr(0, 80) + "\": must be " + FILE_HEADER);
      }
      continue;
    }
    if (line.empty())
    {
      continue;
    }
    entries.push_back(parseLine(line, number));
    try
    {
      checkEntry(entries.back());
    }
    catch (const std::invalid_argument& error)
    {
      throw std::runtime_error("line " + std::to_string(number) + ": " + error.what());
    }
  }
  for (const Entry& entry : entries)
  {
    set(entry);
  }
}

void EtcTable::save(std::ostream& output) const
{
  output << FILE_HEADER << '\n' << std::setprecision(9);
  for (const Entry& entry : entries())
  {
    output << entry.codelet << ',' << entry.bucket << ',' << entry.column << ',' << entry.cell.count << ','
           << entry.cell.mean_s << ',' << entry.cell.deviation_s() << '\n';
  }
}

void EtcTable::load(const std::string& path)
{
  std::ifstream file(path);
  if (!file)
  {
    throw std::runtime_error("cannot open the ETC table " + path);
  }
  try
  {
    load(file);
  }
  catch (const std::runtime_error& error)
  {
    throw std::runtime_error("ETC table " + path + ", " + error.what() + "; mend or remove the file");
  }
}

void EtcTable::save(const std::string& path) const
{
  const std::string part = path + "." + std::to_string(getpid());
  std::ofstream file(part);
  save(file);
  file.close();
  if (!file || std::rename(part.c_str(), path.c_str()) != 0)
  {
    std::remove(part.c_str());
    throw std::runtime_error("cannot write the ETC table " + path);
  }
}

}  // namespace pi_runtime
