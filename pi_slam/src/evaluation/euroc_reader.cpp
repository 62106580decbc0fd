#include "evaluation/sequence_reader.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <boost/algorithm/string.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <utility>
#include <vector>

#include "camera/calibration_yaml.h"

namespace pi_slam
{

namespace
{

namespace fs = std::filesystem;

struct PictureRow
{
  int64_t stamp_ns = 0;
  std::string file;  ///< empty: there is none
};

/// Files of one pair.
struct PairRow
{
  int64_t stamp_ns = 0;
  std::string left;
  std::string right;
};

/// @return text behind the stamp and its comma (empty if there is no comma).
std::string parseStamp(const std::string& file, size_t line, const std::string& text, int64_t* stamp_ns)
{
  const size_t comma = text.find(',');
  const std::string cell = text.substr(0, comma);
  const std::string digits = boost::trim_copy_if(cell, boost::is_any_of(" \t"));
  if (digits.empty() || digits.size() > 18 + 1 || digits.find_first_not_of("0123456789") != std::string::npos)
  {
    throw RecordingError(file, line, "\"" + cell.substr(0, 40) + "\" is no time stamp in nanoseconds");
  }
  *stamp_ns = std::strtoll(digits.c_str(), nullptr, 10);
  return comma == std::string::npos ? "" : text.substr(comma + 1);
}

/// Calls `take(number of line, text)` for every line that is neither empty nor a comment.
template <typename Take>
void forEachLine(const std::string& file, const std::string& content, const Take& take)
{
  std::ifstream stream(file);
  if (!stream)
  {
    throw RecordingError(file + ": missing or not readable; " + content);
  }
  size_t number = 0;
  for (std::string text; std::getline(stream, text);)
  {
    ++number;
    boost::trim_right_if(text, boost::is_any_of("\r "));
    if (!text.empty() && text.front() != '#')
    {
      take(number, text);
    }
  }
}

/// Puts rows in order and leaves out those with the stamp of the one before.
template <typename Row>
void putInOrder(std::vector<Row>* rows, SequenceDefects* defects)
{
  int64_t newest_ns = std::numeric_limits<int64_t>::min();
  for (const Row& row : *rows)
  {
    defects->unsorted += row.stamp_ns < newest_ns ? 1 : 0;
    newest_ns = std::max(newest_ns, row.stamp_ns);
  }
  std::stable_sort(rows->begin(), rows->end(), [](const Row& a, const Row& b) { return a.stamp_ns < b.stamp_ns; });
  const auto end =
      std::unique(rows->begin(), rows->end(), [](const Row& a, const Row& b) { return a.stamp_ns == b.stamp_ns; });
  defects->repeated += static_cast<size_t>(rows->end() - end);
  rows->erase(end, rows->end());
}

std::vector<PictureRow> readPictures(const fs::path& camera, SequenceDefects* defects)
{
  const std::string file = (camera / "data.csv").string();
  std::vector<PictureRow> rows;
  forEachLine(file, "it lists the pictures of a camera (timestamp, filename)",
              [&](size_t line, const std::string& text)
              {
                PictureRow row;
                std::string name = parseStamp(file, line, text, &row.stamp_ns);
                name.erase(0, std::min(name.find_first_not_of(" \t"), name.size()));
                row.file = (camera / "data" / (name.empty() ? std::to_string(row.stamp_ns) + ".png" : name)).string();
                rows.push_back(std::move(row));
              });
  putInOrder(&rows, defects);
  return rows;
}

std::vector<ImuSample> readImu(const fs::path& imu, SequenceDefects* defects)
{
  const std::string file = (imu / "data.csv").string();
  std::vector<ImuSample> samples;
  forEachLine(file, "it has the samples of the IMU (timestamp, 3 of angular rate, 3 of specific force)",
              [&](size_t line, const std::string& text)
              {
                ImuSample sample;
                const std::string values = parseStamp(file, line, text, &sample.stamp_ns);
                const char* cursor = values.c_str();
                for (int i = 0; i < 6; ++i)
                {
                  char* end = nullptr;
                  (i < 3 ? sample.w[i] : sample.f[i - 3]) = std::strtod(cursor, &end);
                  if (end == cursor || (*end != ',' && *end != '\0') || (i < 5 && *end == '\0'))
                  {
                    throw RecordingError(file, line,
                                         "column " + std::to_string(i + 2) + " is no number; expected six of them");
                  }
                  cursor = *end == ',' ? end + 1 : end;
                }
                samples.push_back(sample);
              });
  putInOrder(&samples, defects);
  return samples;
}

/// Pictures of both cameras, joined where their stamps agree.
std::vector<PairRow> joinPairs(const std::vector<PictureRow>& left, const std::vector<PictureRow>& right,
                               int64_t tolerance_ns)
{
  std::vector<PairRow> pairs;
  pairs.reserve(std::max(left.size(), right.size()));
  auto l = left.begin();
  auto r = right.begin();
  while (l != left.end() || r != right.end())
  {
    if (r == right.end() || (l != left.end() && l->stamp_ns < r->stamp_ns - tolerance_ns))
    {
      pairs.push_back({l->stamp_ns, l->file, ""});
      ++l;
    }
    else if (l == left.end() || r->stamp_ns < l->stamp_ns - tolerance_ns)
    {
      pairs.push_back({r->stamp_ns, "", r->file});
      ++r;
    }
    else
    {
      pairs.push_back({l->stamp_ns, l->file, r->file});
      ++l;
      ++r;
    }
  }
  return pairs;
}

/// The IMU's frame must be the body's, as the estimator expects.
void requireImuIsBody(const std::string& file)
{
  std::vector<double> values;
  try
  {
    const YAML::Node transform = loadCalibrationYaml(file)["T_BS"];
    if (!transform)
    {
      return;
    }
    values = transform["data"].as<std::vector<double>>();
  }
  catch (const YAML::Exception& exception)
  {
    throw CalibrationError(file + ": T_BS cannot be read: " + exception.what());
  }
  for (size_t i = 0; i < values.size(); ++i)
  {
    if (values.size() != 16 || !(std::abs(values[i] - (i % 5 == 0 ? 1.0 : 0.0)) < 1e-6))
    {
      throw CalibrationError(file +
                             ": T_BS is not the identity, but the body must be the IMU; give the cameras' T_BS "
                             "with respect to the IMU and the identity here");
    }
  }
}

class EurocSource : public SequenceSource
{
public:
  EurocSource(const std::string& folder, const SequenceReaderOptions& options)
  {
    options.validate();
    if (!fs::is_directory(folder))
    {
      throw RecordingError(folder + ": is no folder; expected one with mav0/cam0, mav0/cam1 and mav0/imu0");
    }
    const fs::path mav = fs::is_directory(fs::path(folder) / "mav0") ? fs::path(folder) / "mav0" : fs::path(folder);
    describe(folder, mav);
    const std::vector<PictureRow> left = readPictures(mav / "cam0", &defects_);
    const std::vector<PictureRow> right = readPictures(mav / "cam1", &defects_);
    samples_ = readImu(mav / "imu0", &defects_);
    pairs_ = joinPairs(left, right, static_cast<int64_t>(1e9 * options.pair_tolerance_s));
    requirePairs(folder, left, right, options);
    cut(folder, options);
  }

  std::optional<SequenceItem> next() override
  {
    while (true)
    {
      const bool has_pair = next_pair_ < pairs_.size();
      if (next_sample_ < samples_.size() &&
          (!has_pair || samples_[next_sample_].stamp_ns <= pairs_[next_pair_].stamp_ns))
      {
        return samples_[next_sample_++];
      }
      if (!has_pair)
      {
        return std::nullopt;
      }
      const PairRow& row = pairs_[next_pair_++];
      if (StereoPair pair{row.stamp_ns, load(row.left), load(row.right)}; hasPicture(pair))
      {
        return pair;
      }
    }
  }

private:
  void describe(const std::string& folder, const fs::path& mav)
  {
    const fs::path path = fs::weakly_canonical(folder);
    description_.name = (path.filename() == "mav0" ? path.parent_path() : path).filename().string();
    const fs::path left = mav / "cam0" / "sensor.yaml";
    const fs::path right = mav / "cam1" / "sensor.yaml";
    if (fs::exists(left) && fs::exists(right))
    {
      description_.calibration = StereoCalibration::loadEuroc(left.string(), right.string());
    }
    const fs::path imu = mav / "imu0" / "sensor.yaml";
    if (fs::exists(imu))
    {
      description_.imu = ImuModel::loadYaml(imu.string());
      requireImuIsBody(imu.string());
    }
    for (const fs::path& truth : {mav.parent_path() / "groundtruth_tum.txt", mav / "groundtruth_tum.txt",
                                  mav / "state_groundtruth_estimate0" / "data.csv"})
    {
      if (description_.ground_truth.empty() && fs::exists(truth))
      {
        description_.ground_truth = truth.string();
      }
    }
  }

  void requirePairs(const std::string& folder, const std::vector<PictureRow>& left,
                    const std::vector<PictureRow>& right, const SequenceReaderOptions& options) const
  {
    if (left.empty() || right.empty())
    {
      throw RecordingError(folder + ": " + (left.empty() ? "cam0" : "cam1") + "/data.csv lists no picture");
    }
    if (samples_.empty())
    {
      throw RecordingError(folder + ": imu0/data.csv has no sample");
    }
    if (std::none_of(pairs_.begin(), pairs_.end(),
                     [](const PairRow& row) { return !row.left.empty() && !row.right.empty(); }))
    {
      throw RecordingError(folder + ": no picture of cam0 is within " + std::to_string(options.pair_tolerance_s) +
                           " s of one of cam1; the cameras do not run in step, or --pair-tolerance is too small");
    }
    if (samples_.back().stamp_ns < pairs_.front().stamp_ns || samples_.front().stamp_ns > pairs_.back().stamp_ns)
    {
      throw RecordingError(folder + ": the IMU's stamps (" + formatSeconds(samples_.front().stamp_ns) + " to " +
                           formatSeconds(samples_.back().stamp_ns) + " s) and the pictures' (" +
                           formatSeconds(pairs_.front().stamp_ns) + " to " + formatSeconds(pairs_.back().stamp_ns) +
                           " s) do not overlap");
    }
  }

  /// Removes what is outside of the span asked for.
  void cut(const std::string& folder, const SequenceReaderOptions& options)
  {
    const double length_s = pi_node::seconds(pairs_.back().stamp_ns - pairs_.front().stamp_ns);
    const int64_t from_ns = pairs_.front().stamp_ns + static_cast<int64_t>(1e9 * options.start_s);
    const int64_t to_ns = options.duration_s > 0.0 ? from_ns + static_cast<int64_t>(1e9 * options.duration_s)
                                                   : std::numeric_limits<int64_t>::max();
    pairs_.erase(std::remove_if(pairs_.begin(), pairs_.end(),
                                [&](const PairRow& row) { return row.stamp_ns < from_ns || row.stamp_ns > to_ns; }),
                 pairs_.end());
    if (pairs_.empty())
    {
      throw RecordingError(folder + ": has no picture from " + std::to_string(options.start_s) + " s on; it is " +
                           std::to_string(length_s) + " s long");
    }
    const auto margin_ns = static_cast<int64_t>(1e9 * IMU_MARGIN_S);
    const auto outside = [&](const ImuSample& sample)
    {
      return sample.stamp_ns < pairs_.front().stamp_ns - margin_ns ||
             sample.stamp_ns > pairs_.back().stamp_ns + margin_ns;
    };
    samples_.erase(std::remove_if(samples_.begin(), samples_.end(), outside), samples_.end());
    description_.pairs = pairs_.size();
    description_.first_ns = pairs_.front().stamp_ns;
  }

  cv::Mat load(const std::string& file)
  {
    if (file.empty())
    {
      return {};
    }
    cv::Mat picture;
    const bool exists = fs::exists(file);
    try
    {
      picture = !exists ? cv::Mat() : cv::imread(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
    }
    catch (const cv::Exception&)
    {
      // As for a file that is damaged otherwise.
    }
    if (picture.empty())
    {
      countUnreadable(file + (exists ? ": is damaged" : ": missing"));
    }
    return picture;
  }

  std::vector<ImuSample> samples_;
  std::vector<PairRow> pairs_;
  size_t next_sample_ = 0;
  size_t next_pair_ = 0;
};

}  // namespace

std::unique_ptr<SequenceSource> openEuroc(const std::string& folder, const SequenceReaderOptions& options)
{
  return std::make_unique<EurocSource>(folder, options);
}

}  // namespace pi_slam
